from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placefield_tools.demo.street import VISIBLE_RANGE
from placefield_tools.demo.street_layout import make_street

seeds = st.integers(min_value=0, max_value=10_000)


@settings(max_examples=10)
@given(seeds)
def test_a_longer_street_begins_like_a_shorter_one(seed):
    short, long = make_street(seed, 60.0), make_street(seed, 200.0)
    for kind in ("buildings", "gaps", "lamps"):
        assert set(getattr(short, kind)) <= set(getattr(long, kind))
    for kind in ("trees", "parked"):
        # At the end of sight a side street of the longer one may take what the shorter one has.
        near = [{t for t in getattr(s, kind) if t.arc < 50 + VISIBLE_RANGE} for s in (short, long)]
        assert near[0] <= near[1]
    assert np.array_equal(short.route.yaw, long.route.yaw[: len(short.route.yaw)])


@settings(max_examples=10)
@given(seeds)
def test_buildings_and_gaps_line_both_sides_without_a_hole(seed):
    street = make_street(seed, 150.0)
    for side in (1, -1):
        fronts = [b for b in street.buildings if b.side == side and not b.behind_gap]
        openings = [g for g in street.gaps if g.side == side]
        pieces = sorted((thing.start, thing.start + thing.width) for thing in fronts + openings)
        assert pieces[0][0] < 0
        assert pieces[-1][1] >= 150 + VISIBLE_RANGE
        for (_, end), (start, _) in pairwise(pieces):
            assert start == pytest.approx(end)


@settings(max_examples=10)
@given(seeds)
def test_nothing_stands_in_the_mouth_of_a_side_street(seed):
    street = make_street(seed, 150.0)
    mouths = [gap for gap in street.gaps if gap.kind == "street"]
    for thing in street.trees + street.parked:
        for gap in mouths:
            same_side = np.sign(thing.offset) == gap.side
            assert not (same_side and gap.start <= thing.arc <= gap.start + gap.width)


def test_points_of_a_route_keep_their_distance_from_its_line():
    route = make_street(2, 100.0).route
    arc = np.linspace(0, 100, 400)
    line, beside = route.point(arc), route.point(arc, 5.0)
    towards = np.stack([np.cos(route.heading(arc)), np.sin(route.heading(arc))], axis=1)
    apart = (beside - line)[:, :2]
    assert np.linalg.norm(apart, axis=1) == pytest.approx(5.0)
    assert (apart * towards).sum(axis=1) == pytest.approx(0.0, abs=1e-9)
    assert (towards[:, 0] * apart[:, 1] - towards[:, 1] * apart[:, 0] > 0).all()
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(100, rel=1e-3)
