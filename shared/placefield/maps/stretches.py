"""Finds the stretches of a drive that a map does not have.

Frames that show no known place may be of a road that the map does not have, or of a known road that
was not recognised, as in the dark. Poses decide. Without poses, a run of such frames is a new
stretch only if the known road is too short for it: between the places before and after the run
there are less than half as many places as the vehicle drove.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import STEPS
from placefield.maps.route_distances import RouteDistances
from placefield.maps.traverse import NO_PLACE, Alignment

LEAST_FRAMES = 20
"""Least frames of a new stretch, of which each shows another place."""

_RATIO = 2  # so many times as long as the known road a new stretch is at least
_HIT, _NEAR = 0.5, 3  # probability that a frame is nearest to a place so near its own

Places = NDArray[np.int32]
Numbers = NDArray[np.intp]


class Stretch(NamedTuple):
    """A stretch of a drive that the map does not have.

    Attributes:
        frames: (n,) int64, the numbers of its frames, ascending: its places.
        before: the place of the map that the vehicle came from; ``NO_PLACE`` at the start.
        after: the place of the map that the vehicle came to; ``NO_PLACE`` at the end.
    """

    frames: Numbers
    before: int
    after: int


class _Run(NamedTuple):
    """The frames from ``start`` up to ``stop``, between two places; see ``Stretch``."""

    start: int
    stop: int
    before: int
    after: int

    def among(self, frames: Numbers) -> Numbers:
        """Return those of the frames that are in the run."""
        return frames[(frames >= self.start) & (frames < self.stop)]


def new_stretches(
    alignment: Alignment, distinct: Numbers, nearest: Places, steps: RouteDistances
) -> list[Stretch]:
    """Return the stretches of a drive of M frames that a map does not have, in their order.

    Args:
        alignment: of the drive to the map.
        distinct: (n,) the numbers of the frames that may become places, ascending; with poses, only
            frames whose pose is known.
        nearest: (M,) int32, the place whose descriptor is nearest to that of each frame.
        steps: between the places of the map.
    """
    places = alignment.places
    if (places == NO_PLACE).all():
        return []
    pace, stretches = _pace(places), []
    for run in _unknown(places):
        if alignment.by != "poses":
            driven = min(len(run.among(distinct)), pace * (run.stop - run.start))
            way = _between(steps, run.before, run.after)
            if way is not None and driven < _RATIO * way:
                continue
            most = len(places) if way is None else math.ceil(way / pace)
            run = _without_known(run, most, pace, nearest, steps)
        frames = run.among(distinct)
        if len(frames) >= LEAST_FRAMES:
            stretches.append(Stretch(frames, run.before, run.after))
    return stretches


def _unknown(places: Places) -> Iterator[_Run]:
    for start, stop in unknown_runs(places):
        before = int(places[start - 1]) if start else NO_PLACE
        after = int(places[stop]) if stop < len(places) else NO_PLACE
        yield _Run(start, stop, before, after)


def unknown_runs(places: Places) -> Iterator[tuple[int, int]]:
    """Yield first frame and last frame + 1 of each run of frames, (M,), without a place."""
    edges = np.diff(np.pad((places == NO_PLACE).astype(np.int8), 1))
    yield from zip(
        np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True
    )


def _pace(places: Places) -> float:
    """Return the mean number of places from frame to frame."""
    is_known = places != NO_PLACE
    steps = np.diff(places)[is_known[1:] & is_known[:-1]]
    steps = steps[(steps >= 0) & (steps <= STEPS)]
    return max(float(steps.mean()), 1 / STEPS) if len(steps) else 1.0


def _between(steps: RouteDistances, before: int, after: int) -> float | None:
    """Return how many places of the map the vehicle may have passed between two places.

    Without one of them, these are all places that may follow, or precede, the other one. None if
    there is no way.
    """
    if before == NO_PLACE or after == NO_PLACE:
        all_steps = steps.to_place(after) if before == NO_PLACE else steps.from_place(before)
        return float(all_steps[np.isfinite(all_steps)].max())
    needed = steps.from_place(before)[after]
    return max(float(needed) - 1, 0.0) if np.isfinite(needed) else None


def _without_known(
    run: _Run, most: int, pace: float, nearest: Places, steps: RouteDistances
) -> _Run:
    """Leave out the frames at both ends that resemble the known road there, ``most`` at each.

    The smoother needs some frames to recognise a road, and to be sure that it was left.
    """
    start, stop, before, after = run
    if before != NO_PLACE:
        known = _known_first(nearest[start:stop][:most], steps.from_place(before), pace)
        start, before = start + known, int(nearest[start + known - 1]) if known else before
    if after != NO_PLACE:
        known = _known_first(nearest[start:stop][::-1][:most], steps.to_place(after), pace)
        stop, after = stop - known, int(nearest[stop - known]) if known else after
    return _Run(start, stop, before, after)


def _known_first(nearest: Places, steps: NDArray[np.float64], pace: float) -> int:
    """Return how many of the first frames most likely show the road from a place on.

    It is the change point of greatest likelihood. A frame that shows the road is nearest to a place
    about where the vehicle must be, in half of all cases; another frame is so by chance.

    Args:
        nearest: (n,) int32, the place that is nearest to each frame.
        steps: (K,), from the place to each.
        pace: places from frame to frame.
    """
    expected = pace * np.arange(1, len(nearest) + 1)
    is_hit = np.abs(steps[nearest] - expected) <= _NEAR
    chance = min((2 * _NEAR + 1) / len(steps), _HIT / 2)
    hit, miss = np.log(_HIT / chance), np.log((1 - _HIT) / (1 - chance))
    likelihood = np.cumsum(np.where(is_hit, hit, miss))
    return int(np.argmax(np.append(0.0, likelihood)))
