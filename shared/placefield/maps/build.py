"""Reference traverses to a map."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config, FeatureConfig, MetricConfig
from placefield.errors import MapError
from placefield.features.extract import default_dimensions
from placefield.features.joined_model import AnyModel, FeaturePart, fit_parts
from placefield.features.kinds import kinds_of
from placefield.maps.build_steps import ONE_BY_ONE, Arrays, Share, Steps
from placefield.maps.gathering import (
    alignment_of,
    centred,
    chosen_rows,
    local_features_of,
    looks_of_others,
    probes_of,
    records_of,
    trained_first,
)
from placefield.maps.linking import linked, same_by_poses
from placefield.maps.map import Map, MapAlignment, MapChannel, MapMetric, Places
from placefield.maps.map_metrics import identity_metric, learned_metric, with_graph, with_looks
from placefield.maps.route_graph import Firsts
from placefield.maps.trajectory import travelled
from placefield.maps.traverse import Traverse
from placefield.matching.revisits import same_places
from placefield.metric.cross_validation import choose_push
from placefield.metric.learn import LearnedMetric, Probes, held_back_frames, learn_projection
from placefield.scales.channels import Channel, make_channels
from placefield.scales.encoding import smallest_scale

HELD_BACK = 0.2  # of the reference, as in the paper

Array = NDArray[np.float32]
Cut = Callable[[Array, Traverse, Config, Steps], tuple[Channel, ...]]
"""Called with the reference traverse's descriptors (K, N), the traverse itself, the settings and
how to carry out the steps."""


def held_back_places(count: int, seed: int) -> NDArray[np.bool_]:
    """Return which places are held back from learning a metric, (count,) bool."""
    return held_back_frames(count, HELD_BACK, seed)


def adaptive_channels(
    descriptors: Array, traverse: Traverse, config: Config, steps: Steps = ONE_BY_ONE
) -> tuple[Channel, ...]:
    """Cut the reference traverse as AMS does, by fuzzy clustering.

    Args:
        descriptors: (K, N) float32, of the reference traverse.
        traverse: the reference traverse.
        config: its scales and seed are used.
        steps: how they are carried out.

    Raises:
        MapError: the reference is too short for this many channels, or the smallest scale is in
            metres and the reference has no poses.
    """
    scales = config.scales
    min_scale, metres = _lower_limit(traverse, config)
    return make_channels(
        descriptors,
        channels=scales.channels,
        clusters=scales.clusters,
        fuzzifiers=scales.fuzzifiers,
        same_start=scales.same_start,
        position_weight=scales.position_weight,
        min_scale=min_scale,
        travelled=metres,
        first=traverse.routes.first,
        seed=config.seed,
        steps=steps,
    )


def _lower_limit(traverse: Traverse, config: Config) -> tuple[float, NDArray[np.floating] | None]:
    """Return the shortest active segment, and, if it is in metres, the metres up to each place.

    Raises:
        MapError: it is in metres, and the traverse has no poses.
    """
    scales = config.scales
    if not scales.min_scale_metres:
        return scales.min_scale, None
    if not len(traverse.poses):
        raise MapError(
            f"--min-scale {scales.min_scale_metres:g}m: {traverse.name} has no poses; give the "
            "smallest scale in frames, or poses in its frames.csv"
        )
    return scales.min_scale_metres, travelled(traverse.poses)


def build_map(
    traverses: Sequence[Traverse],
    config: Config,
    *,
    cut: Cut = adaptive_channels,
    parts: Sequence[FeaturePart] = (),
    steps: Steps = ONE_BY_ONE,
) -> Map:
    """Build a map from one or more traverses of one route, or of a network of routes.

    PCA and metrics learn from all traverses; the places are the first's. A first traverse of
    several routes has a graph; each route is standardised by its own mean and deviation, and a
    query at its start by their mean. With ``build.looks``, the other traverses give looks of
    the places.

    Args:
        traverses: each is aligned to the first, or has the same number of frames.
        config: its features, scales, metric and seed describe the map.
        cut: cuts the reference into segments.
        parts: of the feature, see ``Feature.parts``; none: one part that needs no network.
        steps: how the steps are carried out.

    Raises:
        MapError: a traverse is not aligned and its number of frames differs from the first's, or
            ``cut`` refuses the reference.
    """
    alignments = [alignment_of(traverse, traverses[0]) for traverse in traverses]
    shown = [alignment.shown() for alignment in alignments]
    place_of = [
        alignment.places[frames] for alignment, frames in zip(alignments, shown, strict=True)
    ]
    first = traverses[0]
    parts = parts or (FeaturePart(config.features.kind, None, None),)
    model, descriptors = _described(
        traverses, shown, config.features, parts, steps.share(None, "fitting descriptors")
    )
    places = descriptors[0]
    held_back = held_back_places(len(places), config.seed)
    steps = steps.of([*descriptors, *place_of], config.model_dump_json())
    probes = probes_of(descriptors, place_of, held_back)
    order, places_of = trained_first(held_back, place_of)
    # Without a gate's probes nothing is learned, and of many places a copy is large.
    reference = (
        places[:0] if _learns_nothing(config.metric, probes) else centred(descriptors, order)
    )
    looks = (
        looks_of_others(descriptors, place_of, first.routes.first) if config.build.looks else None
    )
    del descriptors  # the reference has them all
    identity = identity_metric(places, coarse=len(places) >= config.build.coarse_from)
    if looks is not None and len(looks.places):
        identity = with_looks(identity, *looks)
    encoded = cut(places, first, config, steps)
    smallest = smallest_scale(*_lower_limit(first, config))
    labels = [channel.encoding.labels[places_of] for channel in encoded]
    metric_config = _with_push(config, probes, labels[0], reference, places_of)
    trained = len(places_of) - int(held_back[places_of].sum())

    def learn(number: int) -> MapChannel:
        share = steps.share(number, "learning")
        share(0)

        def learned() -> Arrays:
            return _metric(
                labels[number], reference, trained, probes, metric_config, config.seed, share
            ).arrays()

        metric = LearnedMetric.of(*steps.finish(f"channel-{number}-metric", learned))
        channel = _map_channel(encoded[number], smallest, metric, identity, places)
        share(1)
        return channel

    # Found by the rule filter, and followed by it alone; it does not serve plain descriptors.
    graph, same = first.routes, np.arange(len(places), dtype=np.int32)
    if not model.plain:
        same = same_by_poses(_same_places(places, graph.first, steps), first.poses, graph.first)
        graph = linked(graph, same, first.poses)
    channels = tuple(steps.run(learn, range(len(encoded))))
    built = Map(
        preset=config.preset,
        seed=config.seed,
        features=config.features.model_copy(
            update={"dimensions": _most_dimensions(config.features)}
        ),
        scales=config.scales,
        metric=metric_config,
        traverses=records_of(traverses, alignments),
        pose_frame=first.pose_frame if len(first.poses) else None,
        model=model,
        places=_places(first, same),
        channels=channels,
        local_features=local_features_of(traverses, place_of, shown, same, config.seed),
        alignments={
            number: MapAlignment(each.places)
            for number, each in enumerate(alignments[1:], len(graph.names))
        },
        graph=graph,
        identity=identity,
    )
    return built if graph.is_line else with_graph(built, graph)


def _described(
    traverses: Sequence[Traverse],
    shown: Sequence[NDArray[np.intp]],
    features: FeatureConfig,
    parts: Sequence[FeaturePart],
    share: Share,
) -> tuple[AnyModel, list[Array]]:
    """Fit the descriptor model, and describe those frames of each traverse that show a place."""
    first = traverses[0]
    routes = np.split(first.raw, first.routes.first[1:])
    others = zip(traverses[1:], shown[1:], strict=True)
    model, described = fit_parts(
        [*routes, *(chosen_rows(traverse.raw, frames) for traverse, frames in others)],
        parts,
        dimensions=[features.dimensions or default_dimensions(part.kind) for part in parts],
        standardise=features.standardise,
        plain=features.plain_pca,
        routes=len(routes),
        progress=share,
    )
    share(1)
    places = described[0] if len(routes) == 1 else np.concatenate(described[: len(routes)])
    return model, [places, *described[len(routes) :]]


def _most_dimensions(features: FeatureConfig) -> int | None:
    """Return the most dimensions of each part; None if several parts have their own defaults."""
    if features.dimensions is None and len(kinds_of(features.kind)) == 1:
        return default_dimensions(features.kind)
    return features.dimensions


def _map_channel(
    channel: Channel, smallest: int, learned: LearnedMetric, identity: MapMetric, places: Array
) -> MapChannel:
    metric = identity
    if learned.learned:
        coarse = identity.coarse is not None
        metric = learned_metric(learned.projection, places, coarse=coarse)
        if identity.looks is not None:
            looks = identity.looks
            metric = with_looks(metric, looks.places, looks.descriptors, looks.traverses)
    return MapChannel(
        fuzzifier=channel.fuzzifier,
        clusters=int(channel.clusters.max()) + 1,
        metric=metric,
        labels=channel.encoding.labels,
        segments=channel.encoding.segments,
        scales=channel.encoding.scales,
        smallest=smallest,
        curve=learned.curve,
        refusal=learned.refusal,
    )


def _same_places(places: Array, first: Firsts, steps: Steps) -> NDArray[np.int32]:
    share = steps.share(None, "finding revisited places")
    (same,) = steps.finish("same-places", lambda: (same_places(places, first, share),))
    share(1)
    return same


def _learns_nothing(config: MetricConfig, probes: Probes | None) -> bool:
    """Whether no metric can be learned, whatever the frames are."""
    return config.kind == "identity" or (config.gate and probes is None)


def _metric(
    labels: NDArray[np.int32],
    reference: Array,
    trained: int,
    probes: Probes | None,
    config: MetricConfig,
    seed: int,
    progress: Share,
) -> LearnedMetric:
    if config.kind == "identity":
        identity = np.eye(reference.shape[1], dtype=np.float32)
        return LearnedMetric(identity, "none was asked for", np.empty((0, 2)))
    return learn_projection(
        reference,
        labels,
        trained,
        probes,
        config,
        seed,
        on_step=lambda step, *_: progress(step / config.steps),
    )


def _with_push(
    config: Config,
    probes: Probes | None,
    labels: NDArray[np.int32],
    reference: Array,
    places: NDArray[np.integer],
) -> MetricConfig:
    """Return the metric's settings with push as a number, the same for all channels.

    Where push is to be chosen, cross-validation on the labels of the first channel chooses it.
    """
    metric = config.metric
    if not isinstance(metric.push, str):
        return metric
    if metric.kind != "lmnn" or (metric.gate and probes is None):
        return metric.model_copy(update={"push": MetricConfig().push})
    push = choose_push(reference, labels, places, metric, config.seed)
    return metric.model_copy(update={"push": push})


def _places(traverse: Traverse, same: NDArray[np.int32]) -> Places:
    ends = np.cumsum([len(thumbnail) for thumbnail in traverse.thumbnails], dtype=np.int64)
    return Places(
        traverse.stamps,
        traverse.poses,
        traverse.travelled,
        same,
        np.frombuffer(b"".join(traverse.thumbnails), np.uint8),
        ends,
    )
