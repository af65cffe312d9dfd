"""A query traverse on that route."""

import math
from pathlib import Path

import pytest
from turning_route import ORIGIN, PLACES, STAMP_NS

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.maps.digest import NO_DIGEST
from placefield_tools.export.matched_traverse import Localised, QueryTraverse


@pytest.fixture
def traverse() -> QueryTraverse:
    """Three frames, of which the one between the second and the third was not matched."""
    matched = {
        0: MatchMessage(map=NO_DIGEST, place=1, score=1.0, probability=0.995, known=True),
        1: MatchMessage(
            map=NO_DIGEST, place=2, score=2.0, probability=1.0, known=True, pose=(4, 0, math.pi / 2)
        ),
        3: MatchMessage(map=NO_DIGEST, place=4, score=0.1, probability=None),
    }
    matches = [
        Localised(
            Header(stream="drive", sequence=number, stamp_ns=STAMP_NS + number * 100_000_000),
            match,
            (PLACES[match.place, 0], PLACES[match.place, 1], PLACES[match.place, 2]),
        )
        for number, match in matched.items()
    ]
    return QueryTraverse(matches, PLACES, ORIGIN.frame, Path("route.pfmap"), tolerance=1)
