import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.errors import SourceError
from placefield.features.distance_sampler import DistanceSampler, check_spacing


def selected(travelled: NDArray[np.float64], metres: float) -> list[int]:
    spacing = DistanceSampler(metres)
    return [index for index, at in enumerate(travelled) if spacing.is_due(float(at))]


@given(steps=st.lists(st.integers(0, 30)), metres=st.integers(1, 50))
def test_the_first_frame_at_or_behind_each_multiple_of_the_spacing_is_selected(
    steps: list[int], metres: int
) -> None:
    travelled = np.cumsum([1_000_000, *steps])  # millimetres: whole numbers round nothing
    multiples = (travelled - travelled[0]) // metres
    expected = np.unique(multiples, return_index=True)[1].tolist()
    assert selected(travelled / 1000, metres / 1000) == expected


def test_frames_that_come_late_do_not_make_the_next_ones_later() -> None:
    step, metres = 0.3, 1.0
    travelled = 17.2 + step * np.arange(1000)
    late = [
        travelled[index] - travelled[0] - metres * number
        for number, index in enumerate(selected(travelled, metres))
    ]
    assert min(late) > -1e-5
    assert max(late) < step


@pytest.mark.parametrize("metres", [0.0, 1e-310, -1.0, math.nan, math.inf])
def test_what_is_no_distance_is_refused(metres: float) -> None:
    with pytest.raises(SourceError, match=r"^--spacing .*: must be a distance above 0 metres$"):
        check_spacing(metres)
