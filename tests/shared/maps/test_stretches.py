"""The stretches of a drive that a map does not have."""

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.maps.route_graph import NO_LINKS, RouteGraph, line
from placefield.maps.stretches import KnownRoads, Stretch, new_stretches
from placefield.maps.traverse import Alignment

PLACES = 100
NOWHERE = -1


def stretches(
    *parts: NDArray[np.int64] | list[int], by: str = "smoother", graph: RouteGraph | None = None
) -> list[Stretch]:
    """Find the new stretches of a drive by the places that its frames show, part by part.

    The nearest place to each frame is a random one.
    """
    places = np.concatenate(parts).astype(np.int32)
    nearest = np.random.default_rng(4).integers(0, PLACES, len(places)).astype(np.int32)
    alignment = Alignment(places, np.ones(len(places), np.float32), by)  # type: ignore[arg-type]
    roads = KnownRoads(graph or line("road"), PLACES)
    return new_stretches(alignment, np.arange(len(places)), nearest, roads)


def ends(found: list[Stretch]) -> list[tuple[int, int, int, int]]:
    return [(int(s.frames[0]), int(s.frames[-1]), s.before, s.after) for s in found]


def test_what_lies_before_and_behind_a_route_is_new() -> None:
    found = stretches([NOWHERE] * 30, np.arange(PLACES), [NOWHERE] * 40)
    (start, end) = ends(found)
    assert start[2:] == (NOWHERE, 0)
    assert end[2:] == (PLACES - 1, NOWHERE)
    assert start[0] == 0
    assert start[1] in range(25, 30)
    assert end[0] in range(130, 136)


def test_a_detour_that_is_far_longer_than_the_road_is_new() -> None:
    (found,) = stretches(np.arange(50), [NOWHERE] * 45, np.arange(60, PLACES))
    assert abs(found.before - 49) <= 3
    assert abs(found.after - 60) <= 3
    assert len(found.frames) >= 40


@pytest.mark.parametrize(
    "parts",
    [
        (np.arange(20), [NOWHERE] * 60, np.arange(80, PLACES)),
        ([NOWHERE] * 40, np.arange(40, PLACES)),
        (np.arange(60), [NOWHERE] * 40),
        (np.arange(50), [NOWHERE] * 15, np.arange(50, PLACES)),
        (np.arange(0, 40, 2), [NOWHERE] * 30, np.arange(70, PLACES, 2)),
        ([NOWHERE] * 80,),
    ],
    ids=["on the way", "at the start", "at the end", "short", "at twice the speed", "throughout"],
)
def test_a_run_that_the_known_road_has_room_for_is_none(parts: tuple[list[int], ...]) -> None:
    assert stretches(*parts) == []


def test_poses_need_no_such_proof() -> None:
    found = stretches(np.arange(20), [NOWHERE] * 60, np.arange(80, PLACES), by="poses")
    assert ends(found) == [(20, 79, 19, 80)]


def test_links_are_roads_and_there_is_none_between_routes_without_one() -> None:
    first = np.array([0, 50], np.int32)
    drive = (np.arange(20), [NOWHERE] * 30, np.arange(75, PLACES))
    linked = RouteGraph(("a", "b"), first, np.array([[30, 60]], np.int32))
    assert KnownRoads(linked, PLACES).from_place(19)[75] == 11 + 1 + 15
    assert stretches(*drive, graph=linked) == []
    apart = RouteGraph(("a", "b"), first, NO_LINKS)
    assert len(stretches(*drive, graph=apart)) == 1


def test_frames_at_the_ends_that_show_the_road_are_not_part_of_it() -> None:
    places = np.r_[np.arange(90), np.full(60, NOWHERE)].astype(np.int32)
    nearest = np.r_[np.arange(100), np.random.default_rng(4).integers(0, 80, 50)].astype(np.int32)
    alignment = Alignment(places, np.ones(150, np.float32), "smoother")
    (found,) = new_stretches(alignment, np.arange(150), nearest, KnownRoads(line("road"), PLACES))
    assert ends([found]) == [(100, 149, 99, NOWHERE)]
