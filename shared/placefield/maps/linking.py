"""Links between the places of a map: where stretches are the same, and where poses meet.

An overlap is a run of places of one route that show the same stretch as places of another route, or
as earlier places of their own. Its copies stay apart: links let a vehicle enter and leave each copy
by every way. At each end of an overlap, the last place before it links to the first place in the
other copy, and the last place of each copy to the place behind the other copy.

If the end of a route has no way on, it links to the place that lies ahead by the poses: the start
of a circuit, or another route. Likewise the start of a route.
"""

from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.maps.alignment import NEAR_M, align_by_poses
from placefield.maps.map import STEPS
from placefield.maps.route_graph import Firsts, Link, RouteGraph, as_links, routes_of
from placefield.maps.traverse import NO_PLACE

_APART = 40  # places of one route between the ends of a link by poses: nearer ones are neighbours
_SPACINGS = 2.0  # mean distances of places within which a route goes on
_SAME_HEADING = 0.5  # cosine of the largest turn

Poses = NDArray[np.float64]
Same = NDArray[np.int32]


class Overlap(NamedTuple):
    """A run of places of one route, and the earlier places that show the same stretch.

    Attributes:
        first: the first place of the run.
        last: its last place.
        twin_of_first: the place that the first one is the same as.
        twin_of_last: the place that the last one is the same as.
    """

    first: int
    last: int
    twin_of_first: int
    twin_of_last: int


def overlaps(same: Same, first: Firsts) -> list[Overlap]:
    """Return the overlaps of routes, by ascending place.

    Args:
        same: (K,) int32, for each place the earliest place that shows the same stretch, or itself.
        first: (R,) int32, the first place of each route.
    """
    places = np.arange(len(same))
    route = routes_of(first, places)
    is_twin = same != places
    goes_on = (
        is_twin[1:]
        & is_twin[:-1]
        & (np.diff(route) == 0)
        & (np.diff(route[same]) == 0)
        & (np.abs(np.diff(same)) <= STEPS)
    )
    runs = np.split(places, np.flatnonzero(~goes_on) + 1)
    ends = [run[[0, -1]] for run in runs if is_twin[run[0]]]
    return [Overlap(*run.tolist(), *same[run].tolist()) for run in ends]


def same_by_poses(same: Same, poses: Poses, first: Firsts) -> Same:
    """Add which places are the same by their poses to those that are known to be the same.

    A place is the same as the nearest one of the earlier routes, within 5 m in about the same
    heading. A place that lies ahead of the end of a route, or behind its start, is not the same.

    Args:
        same: (K,) int32, see ``overlaps``; what it knows is kept.
        poses: (K, 3) float64, x and y in metres and yaw in radians, NaN where unknown; or (0, 3).
        first: (R,) int32, the first place of each route.
    """
    found = same.copy()
    if not len(poses):
        return found
    spacing, route = _spacings(poses, first), routes_of(first, np.arange(len(same)))
    for start, end in _bounds(first, len(same)):
        nearest = align_by_poses(poses[:start], poses[start:end]).places
        for frame in np.flatnonzero(nearest != NO_PLACE).tolist():
            place, twin = start + frame, int(nearest[frame])
            is_beside = abs(_ahead(poses[twin], poses[place])) <= spacing[route[twin]]
            if found[place] == place and is_beside:
                found[place] = twin
    for place, twin in enumerate(found.tolist()):
        found[place] = found[twin]
    return found


def linked(graph: RouteGraph, same: Same, poses: Poses) -> RouteGraph:
    """Return a graph with the links of its overlaps, and those by poses, besides its own.

    Args:
        graph: of K places.
        same: (K,) int32, see ``overlaps``.
        poses: (K, 3) float64, as in ``same_by_poses``.
    """
    links = {(int(one), int(other)) for one, other in graph.links}
    for overlap in overlaps(same, graph.first):
        links |= _links_of(overlap, graph.first, len(same))
    if len(poses):
        links |= _links_by_poses(graph.first, poses, links)
    return replace(graph, links=as_links(links))


def _links_of(overlap: Overlap, first: Firsts, count: int) -> set[Link]:
    """Return the links at both ends of an overlap, where the places exist in their routes."""
    starts, behind_ends = set(first.tolist()), {*first.tolist(), count}
    begin = (overlap.first, overlap.twin_of_first)
    end = (overlap.last, overlap.twin_of_last)
    entered = {(one - 1, other) for one, other in (begin, begin[::-1]) if one not in starts}
    left = {(one, other + 1) for one, other in (end, end[::-1]) if other + 1 not in behind_ends}
    return entered | left


def _links_by_poses(first: Firsts, poses: Poses, links: set[Link]) -> set[Link]:
    """Return links at those ends and starts of routes that no link leaves or enters."""
    found = set()
    left, entered = {one for one, _ in links}, {other for _, other in links}
    for spacing, (start, end) in zip(
        _spacings(poses, first), _bounds(first, len(poses)), strict=True
    ):
        reach = max(NEAR_M, _SPACINGS * spacing)
        last, allowed = end - 1, np.ones(len(poses), np.bool_)
        allowed[max(end - _APART, start) : end] = False
        if last not in left and (ahead := _nearest(poses, last, allowed, reach)) is not None:
            found.add((last, ahead))
        allowed[:] = True
        allowed[start : min(start + _APART, end)] = False
        if start not in entered and (behind := _nearest(poses, start, allowed, -reach)) is not None:
            found.add((behind, start))
    return found


def _nearest(poses: Poses, place: int, allowed: NDArray[np.bool_], reach: float) -> int | None:
    """Return the nearest allowed place that lies ahead of a place in about the same heading.

    Args:
        poses: of all places.
        place: whose heading counts.
        allowed: (K,) bool, the places to choose from.
        reach: the largest distance, metres; negative: the place lies behind.
    """
    distances = np.linalg.norm(poses[:, :2] - poses[place, :2], axis=1)
    is_ahead = np.sign(reach) * _ahead(poses[place], poses) >= 0
    turned = np.cos(poses[:, 2] - poses[place, 2]) < _SAME_HEADING
    chosen = np.flatnonzero(allowed & (distances <= abs(reach)) & is_ahead & ~turned)
    return int(chosen[np.argmin(distances[chosen])]) if len(chosen) else None


def _ahead(pose: Poses, others: Poses) -> NDArray[np.float64]:
    """Return how far other poses (..., 3) lie ahead of a pose (3,), metres along its heading."""
    x, y, yaw = pose
    return np.asarray((others[..., 0] - x) * np.cos(yaw) + (others[..., 1] - y) * np.sin(yaw))


def _spacings(poses: Poses, first: Firsts) -> list[float]:
    """Return the mean distance of consecutive places of each route, metres; 0 where unknown."""
    steps = [
        np.linalg.norm(np.diff(poses[slice(*bounds), :2], axis=0), axis=1)
        for bounds in _bounds(first, len(poses))
    ]
    known = [each[np.isfinite(each)] for each in steps]
    return [float(each.mean()) if len(each) else 0.0 for each in known]


def _bounds(first: Firsts, count: int) -> list[tuple[int, int]]:
    """Return the first place of each route, and the last one + 1."""
    return list(pairwise([*first.tolist(), count]))
