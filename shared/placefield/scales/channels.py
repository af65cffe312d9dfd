"""Clusters and encodes a reference traverse once per channel (Eq. 9)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.build_steps import ONE_BY_ONE, Arrays, Steps
from placefield.maps.route_graph import ONE_ROUTE, Firsts
from placefield.scales.clustering import cluster
from placefield.scales.encoding import Encoding, encode
from placefield.scales.placed import Placed, with_route_position
from placefield.scales.subtractive import PLACED, UNPLACED, estimate_clusters

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
    steps: Steps = ONE_BY_ONE,
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
        steps: how they are carried out.

    Raises:
        ConfigError: a fuzzifier is not above 1.
        MapError: the reference is too short: a channel has fewer than two active segments, or there
            are fewer frames than clusters.
    """
    frames = with_route_position(vectors, position_weight)
    if clusters is None:
        clusters = _estimated(frames, position_weight, steps)
    spread = np.linspace(*fuzzifiers, channels).tolist()

    def make(number: int) -> Channel:
        def clustered() -> Arrays:
            def swept(done: int, total: int) -> None:
                steps.progress(number, "clustering", done / total)

            start = seed if same_start else seed + number
            return (cluster(frames, clusters, spread[number], start, swept).labels,)

        (labels,) = steps.finish(f"channel-{number}-clusters", clustered)
        steps.progress(number, "clustering", 1)
        encoding = encode(labels, min_scale, travelled, first)
        least = f"{min_scale:g} {'frames' if travelled is None else 'm'}"
        _refuse_too_few(encoding, number, least)
        return Channel(spread[number], labels, encoding)

    return tuple(steps.run(make, range(channels)))


def _estimated(frames: Placed, position_weight: float, steps: Steps) -> int:
    """Estimate the number of clusters, with the position at weight 1 unless its weight is 0."""
    radius = PLACED if position_weight else UNPLACED
    if position_weight not in (0, 1):
        frames = with_route_position(frames.vectors, 1.0)
    share = steps.share(None, "estimating clusters")

    def estimated() -> Arrays:
        return (np.array(estimate_clusters(frames, radius, share)),)

    (clusters,) = steps.finish("clusters", estimated)
    share(1)
    return int(clusters)


def _refuse_too_few(encoding: Encoding, number: int, least: str) -> None:
    segments, frames = len(encoding.segments), len(encoding.labels)
    if segments < _MIN_SEGMENTS:
        raise MapError(
            f"the reference of {frames} frames is too short, or its frames are too alike: channel "
            f"{number} has {segments} active segments of {least} or more and needs "
            f"{_MIN_SEGMENTS}: give more frames, lower --min-scale"
            + (", or ask for fewer channels" if number else "")
        )
