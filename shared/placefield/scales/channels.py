"""Clusters and encodes a reference traverse once per channel (Eq. 9)."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.route_graph import ONE_ROUTE, Firsts
from placefield.scales.clustering import cluster, with_route_position
from placefield.scales.encoding import Encoding, encode
from placefield.scales.subtractive import PLACED, UNPLACED, estimate_clusters

Item = TypeVar("Item")
Result = TypeVar("Result")
Progress = Callable[[int, float], None]
"""Called with a channel's number and the fraction of it that is done, in any process."""


class Run(Protocol):
    """Applies a function to all channels: ``map``, or a similar function on several cores."""

    def __call__(
        self, function: Callable[[Item], Result], items: Iterable[Item], /
    ) -> Iterable[Result]:
        """Return the results in the order of the items."""


_MIN_SEGMENTS = 2  # with fewer, no place can be told from another


@dataclass(frozen=True)
class Channel:
    """One channel's segments of the reference traverse of K frames.

    Attributes:
        fuzzifier: m of Eq. 2.
        clusters: (K,) int32, the cluster of each frame.
        encoding: the active segments and their scales.
    """

    fuzzifier: float
    clusters: NDArray[np.int32]
    encoding: Encoding


def make_channels(
    vectors: NDArray[np.float32],
    *,
    channels: int,
    min_scale: float,
    seed: int,
    clusters: int | None = None,
    fuzzifiers: tuple[float, float] = (1.02, 1.4),
    same_start: bool = False,
    position_weight: float = 1.0,
    travelled: NDArray[np.floating] | None = None,
    first: Firsts = ONE_ROUTE,
    run: Run = map,
    progress: Progress = lambda number, fraction: None,
) -> tuple[Channel, ...]:
    """Cluster and encode a reference traverse in several overlapping ways.

    The channels' fuzzifiers are spread evenly. Similar fuzzifiers alone give nearly the same
    clusters, so each channel's clustering also starts from its own stretches, unless ``same_start``
    is set, as published.

    Args:
        vectors: (K, N) float32 descriptors in route order. They must not be standardised after PCA:
            with equal variances noise hides what consecutive frames have in common, and the cuts
            are arbitrary.
        channels: how many.
        min_scale: lower limit of a segment, see `encode`.
        seed: of all channels.
        clusters: per channel; None estimates them (`estimate_clusters`).
        fuzzifiers: m of the first and of the last channel, above 1.
        same_start: whether all channels start from the same stretches.
        position_weight: of the frame's position in the route, see `with_route_position`.
        travelled: (K,) metres travelled up to each frame, if `min_scale` is in metres.
        first: (R,) int32, the first frame of each route; no segment lies in two routes.
        run: applies a function to all channels, which do not depend on each other.
        progress: receives every channel's progress; an exception of it ends the work.

    Raises:
        ConfigError: a fuzzifier is not above 1.
        MapError: the reference is too short: a channel has fewer than two active segments, or there
            are fewer frames than clusters.
    """
    if clusters is None:
        clusters = _estimated(vectors, position_weight)
    placed = with_route_position(vectors, position_weight)
    spread = np.linspace(*fuzzifiers, channels).tolist()

    def make(number: int) -> Channel:
        def swept(done: int, total: int) -> None:
            progress(number, done / total)

        start = seed if same_start else seed + number
        labels = cluster(placed, clusters, spread[number], start, swept).labels
        progress(number, 1)
        encoding = encode(labels, min_scale, travelled, first)
        least = f"{min_scale:g} {'frames' if travelled is None else 'm'}"
        _refuse_too_few(encoding, number, least)
        return Channel(spread[number], labels, encoding)

    return tuple(run(make, range(channels)))


def _estimated(vectors: NDArray[np.float32], position_weight: float) -> int:
    """Estimate the number of clusters, with the position unless its weight is 0."""
    if position_weight == 0:
        return estimate_clusters(vectors, UNPLACED)
    return estimate_clusters(with_route_position(vectors, 1.0), PLACED)


def _refuse_too_few(encoding: Encoding, number: int, least: str) -> None:
    segments, frames = len(encoding.segments), len(encoding.labels)
    if segments < _MIN_SEGMENTS:
        raise MapError(
            f"the reference of {frames} frames is too short, or its frames are too alike: channel "
            f"{number} has {segments} active segments of {least} or more and needs "
            f"{_MIN_SEGMENTS}: give more frames, lower --min-scale"
            + (", or ask for fewer channels" if number else "")
        )
