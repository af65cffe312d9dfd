"""A frame in which there was nothing to see: its descriptor is zero, and tells nothing."""

import numpy as np
import pytest

from placefield.config import MatchingConfig, Rule
from placefield.matching.candidate import UNANSWERED
from placefield.recognizer import Recognizer
from placefield_tools.bench.made import made_map
from placefield_tools.bench.walks import random_walk


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("rule", ["filter", "evidence"])
def test_it_tells_no_place_from_another(rule: Rule, reverse: bool) -> None:
    recognizer = Recognizer(
        made_map(random_walk(200, 40, seed=0)), MatchingConfig(rule=rule, reverse=reverse)
    )
    match = recognizer.push_descriptor(np.zeros(40, np.float32))
    if rule == "evidence":
        assert match.place == UNANSWERED
    else:
        assert match.probability == pytest.approx(7 / 200 * 0.5 * 0.2, rel=1e-3)
