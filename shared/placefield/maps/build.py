"""Reference traverses to a map."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import MapError
from placefield.features.descriptors import fit_descriptors
from placefield.features.extract import default_dimensions
from placefield.features.network import Network
from placefield.maps.manifest import TraverseRecord
from placefield.maps.map import Map, MapChannel, Places
from placefield.maps.traverse import Traverse
from placefield.metric.learn import LearnedMetric, Probes, held_back_frames, learn_projection
from placefield.scales.channels import Channel, make_channels

HELD_BACK = 0.2  # of the reference, as in the paper

Array = NDArray[np.float32]
Progress = Callable[[int, int], None]
"""Called with how many channels are done, and of how many."""

Cut = Callable[[Array, Traverse, Config], tuple[Channel, ...]]
"""Called with the reference traverse's descriptors (K, N), the traverse itself and the settings."""


def held_back_places(count: int, seed: int) -> NDArray[np.bool_]:
    """Return which places are held back from learning a metric, (count,) bool."""
    return held_back_frames(count, HELD_BACK, seed)


def adaptive_channels(
    descriptors: Array, traverse: Traverse, config: Config
) -> tuple[Channel, ...]:
    """Cut the reference traverse as AMS does, by fuzzy clustering.

    Args:
        descriptors: (K, N) float32, of the reference traverse.
        traverse: the reference traverse.
        config: its scales and seed say how.

    Raises:
        MapError: the reference is too short for the channels asked for; the smallest scale is in
            metres, but the reference has no poses.
    """
    scales = config.scales
    in_metres = scales.min_scale_metres > 0
    if in_metres and not len(traverse.poses):
        raise MapError(
            f"--min-scale {scales.min_scale_metres:g}m: {traverse.name} has no poses; give the "
            "smallest scale in frames, or poses in its frames.csv"
        )
    return make_channels(
        descriptors,
        channels=scales.channels,
        clusters=scales.clusters,
        position_weight=scales.position_weight,
        min_scale=scales.min_scale_metres or scales.min_scale,
        travelled=_travelled(traverse.poses) if in_metres else None,
        seed=config.seed,
    )


def build_map(
    traverses: Sequence[Traverse],
    config: Config,
    progress: Progress = lambda done, total: None,
    cut: Cut = adaptive_channels,
    network: Network | None = None,
) -> Map:
    """Build a map from one or more traverses of one route, aligned by index.

    PCA and metrics learn from all traverses; the places are the first's.

    Args:
        traverses: of equal length.
        config: its features, scales, metric and seed describe the map.
        progress: told of every channel that is done.
        cut: how the reference becomes segments.
        network: that the raw features are the output of, if so; the map keeps it.

    Raises:
        MapError: the traverses differ in length, or ``cut`` refuses the reference.
    """
    _check_aligned(traverses)
    dimensions = config.features.dimensions or default_dimensions(config.features.kind)
    features = config.features.model_copy(update={"dimensions": dimensions})
    model, descriptors = fit_descriptors(
        [traverse.raw for traverse in traverses],
        features.kind,
        dimensions=dimensions,
        standardise=features.standardise,
        network=network,
    )
    first = traverses[0]
    probes = _probes(descriptors, config)
    channels = []
    encoded = cut(descriptors[0], first, config)
    for number, channel in enumerate(encoded):
        progress(number, len(encoded))
        channels.append(_learn(channel, descriptors, probes, config))
    progress(len(encoded), len(encoded))
    return Map(
        seed=config.seed,
        features=features,
        scales=config.scales,
        metric=config.metric,
        traverses=tuple(TraverseRecord(name=t.name, frames=len(t.raw)) for t in traverses),
        pose_frame="route" if len(first.poses) else None,
        model=model,
        places=_places(first),
        channels=tuple(channels),
    )


def _check_aligned(traverses: Sequence[Traverse]) -> None:
    first = traverses[0]
    for other in traverses[1:]:
        if len(other.raw) != len(first.raw):
            raise MapError(
                f"{other.name} has {len(other.raw)} frames and {first.name} {len(first.raw)}: "
                "traverses of one map are aligned by index and need as many frames each"
            )


def _travelled(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Metres travelled up to each pose, (K,)."""
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _probes(descriptors: Sequence[Array], config: Config) -> Probes | None:
    """Make the gate's questions: the held-back places as the other traverses saw them, if any."""
    first, *others = descriptors
    if not others:
        return None
    truth = np.flatnonzero(held_back_places(len(first), config.seed))
    asked = np.concatenate([other[truth] for other in others])
    return Probes(first, asked, np.tile(truth, len(others)))


def _learn(
    channel: Channel, descriptors: Sequence[Array], probes: Probes | None, config: Config
) -> MapChannel:
    places = descriptors[0]
    labels = channel.encoding.labels
    metric = _metric(labels, descriptors, probes, config)
    return MapChannel(
        fuzzifier=channel.fuzzifier,
        clusters=int(channel.clusters.max()) + 1,
        learned=metric.learned,
        projection=metric.projection,
        places=places @ metric.projection.T if metric.learned else places,
        labels=labels,
        segments=channel.encoding.segments,
        scales=channel.encoding.scales,
        curve=metric.curve,
    )


def _metric(
    labels: NDArray[np.int32], descriptors: Sequence[Array], probes: Probes | None, config: Config
) -> LearnedMetric:
    count, dimensions = descriptors[0].shape
    if config.metric.kind == "identity":
        identity = np.eye(dimensions, dtype=np.float32)
        return LearnedMetric(identity, "none was asked for", np.empty((0, 2)))
    return learn_projection(
        np.concatenate(descriptors),
        np.tile(labels, len(descriptors)),
        np.tile(held_back_places(count, config.seed), len(descriptors)),
        probes,
        config.metric,
        config.seed,
    )


def _places(traverse: Traverse) -> Places:
    ends = np.cumsum([len(thumbnail) for thumbnail in traverse.thumbnails], dtype=np.int64)
    return Places(
        traverse.stamps,
        traverse.poses,
        np.frombuffer(b"".join(traverse.thumbnails), np.uint8),
        ends,
    )
