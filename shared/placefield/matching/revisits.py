"""Finds the later places of a reference that show the same stretch as earlier ones.

A stretch may be driven twice, in one route or in several. The reference is recognised as if it were
a query, by the rule ``filter`` and smoothed, but each of its frames only among clearly earlier
places: those of earlier routes, and of its own route long before. Or the vehicle is at none of
them, as behind a fork. Different places that look alike must never be joined, so the requirements
are high: long runs of frames that are all but certain, most of which are nearest to their twin. A
stretch that is driven in reverse is another stretch, because the camera faces the other way.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.maps.map import STEPS
from placefield.maps.map_metrics import identity_metric
from placefield.maps.route_graph import ONE_ROUTE, Firsts, bounds_of, routes_of
from placefield.matching.best_window import Vicinity, best_window, twins_in
from placefield.matching.candidate import Candidate
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.filter_matcher import UNMAPPED, FilterMatcher, WholeMap
from placefield.matching.growing_places import lengths_of
from placefield.matching.matcher import WHOLE_DRIVE
from placefield.matching.smoother import Smoother

MOST = 4000
"""Most places that are searched; a longer reference is sampled evenly."""

_GAP = 20  # places; nearer places of a route are neighbours, which look alike
_APART = 2 * _GAP  # least places of a route between a place and its twin, which is no neighbour
_LIKELY = 0.9  # probability of each frame of a run
_CERTAIN, _LEAST = 0.999, 12  # a run must have so many frames of this probability
_NEAREST = 0.5  # fraction of a run whose nearest earlier place must be the twin
_TOLERANCE = 3  # places
_PART, _AROUND = 200, 40  # frames that are recognised together, and context on either side

Array = NDArray[np.float32]
Same = NDArray[np.int32]


class _Recognised(NamedTuple):
    """The k frames of a reference, recognised among clearly earlier places.

    Attributes:
        nearest: (k,) int64, the place that is nearest to each frame.
        posteriors: of each frame, places (n,) int32, ascending, and the belief in each, (n,)
            float32.
    """

    nearest: NDArray[np.int64]
    posteriors: list[tuple[Same, Array]]


class _Revisit(NamedTuple):
    """Consecutive frames, from ``first`` on, and the place that each is the same as, (n,) int32."""

    first: int
    twins: Same


def same_places(
    descriptors: Array,
    first: Firsts = ONE_ROUTE,
    progress: Callable[[float], None] = lambda share: None,
) -> Same:
    """Return the earliest place that each is the same as, itself where there is none, (K,) int32.

    The cost is quadratic in the places. Of more than ``MOST`` places, only every n-th is searched.
    A place between two recognised ones is the same as the most similar place near its expected
    position. Only stretches that are n times as long are found then.

    Args:
        descriptors: (K, N) float32, of the reference, of length 1.
        first: (R,) int32, the first place of each route.
        progress: called with the fraction that is done; an exception of it ends the search.
    """
    every = -(-len(descriptors) // MOST)
    searched, starts = descriptors[::every], -(-first // every)
    recognised = _recognised(searched, starts, progress)
    runs: list[_Revisit] = []
    while True:  # once two laps share their places, a third lap can be recognised
        more = _runs(recognised, _joined(searched, runs), starts)
        if sum(len(run.twins) for run in more) <= sum(len(run.twins) for run in runs):
            return _joined(descriptors, runs, every)
        runs = more


def _recognised(
    descriptors: Array, starts: Firsts, progress: Callable[[float], None]
) -> _Recognised:
    """Recognise frames part by part, to limit the memory for frames that are not smoothed yet."""
    metric = identity_metric(descriptors)
    lengths, vicinity = lengths_of(metric), Vicinity(_TOLERANCE)
    whole, all_places = WholeMap(lengths, None, None, UNMAPPED), slice(0, len(descriptors))
    places = MetricPlaces(metric, exact=True)
    nearest: list[int] = []
    posteriors: list[tuple[Same, Array]] = []
    for route, end in bounds_of(starts, len(descriptors)):
        for start in range(route, end, _PART):
            smoother = Smoother(lengths, WHOLE_DRIVE, vicinity)
            matcher = FilterMatcher(whole, all_places, 0, [smoother])
            first = max(start - _AROUND, route)
            stop = min(start + _PART + _AROUND, end)
            resembled: list[int] = []
            for frame in _among_earlier(places, descriptors, (first, stop), route):
                resembled.append(int(np.argmin(frame.distances)))
                matcher.update(frame)
            own = slice(start - first, min(start + _PART, end) - first)
            nearest += resembled[own]
            posteriors += [_posterior(candidate) for candidate, _ in matcher.finish()[own]]
            progress(len(nearest) / len(descriptors))
    return _Recognised(np.array(nearest), posteriors)


def _posterior(candidate: Candidate) -> tuple[Same, Array]:
    """Return a candidate's places and their beliefs; one place of belief 0 if it has none."""
    if not len(candidate.places):
        return np.zeros(1, np.int32), np.zeros(1, np.float32)
    return candidate.places, candidate.evidence


def _among_earlier(
    places: MetricPlaces, descriptors: Array, frames: tuple[int, int], route: int
) -> Iterator[Comparison]:
    """Compare frames with clearly earlier places; all other places get the mean distance.

    Args:
        places: of all routes.
        descriptors: of all frames.
        frames: the first frame, and the last one + 1.
        route: the first place of their route.
    """
    for number, frame in enumerate(places.compare(descriptors[slice(*frames)]), frames[0]):
        distances = frame.distances.copy()
        distances[max(number - _GAP + 1, route) :] = distances.mean()
        yield replace(frame, distances=distances)


def _runs(recognised: _Recognised, same: Same, starts: Firsts) -> list[_Revisit]:
    """Return the runs of frames that are surely the same as earlier places.

    A run is in one route, and so are its twins.

    Args:
        recognised: the frames.
        same: (k,) int32, which place each is known to be the same as.
        starts: (R,) int32, the first frame of each route.
    """
    frames = np.arange(len(same))
    route = routes_of(starts, frames)
    vicinity = Vicinity(_TOLERANCE, twins_in(same))
    windows = [best_window(*each, vicinity) for each in recognised.posteriors]
    places = np.array([place for place, _ in windows])
    probabilities = np.array([probability for _, probability in windows])
    twins = same[places]
    is_earlier = (frames - places >= _APART) | (route[places] < route)
    likely = (probabilities >= _LIKELY) & is_earlier
    one_route = (np.diff(route) == 0) & (np.diff(route[twins]) == 0)
    follows = likely[1:] & likely[:-1] & (np.abs(np.diff(twins)) <= STEPS) & one_route
    resembles = np.abs(same[recognised.nearest] - twins) <= _TOLERANCE
    runs = []
    for run in np.split(frames, np.flatnonzero(~follows) + 1):
        certain = np.count_nonzero(likely[run] & (probabilities[run] >= _CERTAIN))
        if certain >= _LEAST and resembles[run].mean() >= _NEAREST:
            runs.append(_Revisit(int(run[0]), twins[run]))
    return runs


def _joined(descriptors: Array, runs: Sequence[_Revisit], every: int = 1) -> Same:
    """Return which place each is the same as, (K,), given runs of every n-th place."""
    same = np.arange(len(descriptors), dtype=np.int32)
    for first, twins in runs:
        frames = np.arange(first * every, (first + len(twins) - 1) * every + 1)
        known = (first + np.arange(len(twins))) * every
        expected = np.interp(frames, known, twins * float(every)).round().astype(np.int32)
        for frame, place in zip(frames, expected, strict=True):
            around, end = max(place - every + 1, 0), min(place + every, frame)
            alike = descriptors[around:end] @ descriptors[frame]
            same[frame] = same[around + int(np.argmax(alike))]
    return same
