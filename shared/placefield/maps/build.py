"""Reference traverses to a map."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config, FeatureConfig
from placefield.features.extract import default_dimensions
from placefield.features.joined_model import AnyModel, FeaturePart, fit_parts
from placefield.features.kinds import kinds_of
from placefield.maps.build_steps import ONE_BY_ONE, Share, Steps
from placefield.maps.cutting import Cut, adaptive_channels, lower_limit
from placefield.maps.gathering import (
    alignment_of,
    chosen_rows,
    local_features_of,
    looks_of_others,
    records_of,
)
from placefield.maps.learning import Training, learn_metric, with_push
from placefield.maps.linking import linked, same_by_poses
from placefield.maps.map import Map, MapAlignment, MapChannel, MapMetric, Places
from placefield.maps.map_metrics import identity_metric, learned_metric, with_graph, with_looks
from placefield.maps.route_graph import RouteGraph
from placefield.maps.traverse import Traverse
from placefield.matching.revisits import same_places
from placefield.metric.learn import LearnedMetric
from placefield.scales.channels import Channel
from placefield.scales.encoding import smallest_scale

Array = NDArray[np.float32]


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
    steps = steps.of([*descriptors, *place_of], config.model_dump_json())
    training = Training.of(descriptors, place_of, config)
    identity = identity_metric(places, coarse=len(places) >= config.build.coarse_from)
    if config.build.looks:
        looks = looks_of_others(descriptors, place_of, first.routes.first)
        identity = with_looks(identity, *looks) if len(looks.places) else identity
    del descriptors  # the training has them all
    cuts = cut(places, first, config, steps)
    config = with_push(config, training, cuts[0].encoding.labels)
    smallest = smallest_scale(*lower_limit(first, config))

    def channel(number: int) -> MapChannel:
        labels = cuts[number].encoding.labels
        learned = learn_metric(number, labels, training, config, steps)
        return _map_channel(cuts[number], smallest, learned, identity, places)

    graph, same = _roads(model, places, first, steps)
    channels = tuple(steps.run(channel, range(len(cuts))))
    built = Map(
        preset=config.preset,
        seed=config.seed,
        features=config.features.model_copy(
            update={"dimensions": _most_dimensions(config.features)}
        ),
        scales=config.scales,
        metric=config.metric,
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


def _roads(
    model: AnyModel, places: Array, first: Traverse, steps: Steps
) -> tuple[RouteGraph, NDArray[np.int32]]:
    """Return the graph of the first traverse with the links found, and which places are the same.

    They are found by the rule ``filter``, which does not serve plain descriptors, and followed by
    it alone.
    """
    graph = first.routes
    if model.plain:
        return graph, np.arange(len(places), dtype=np.int32)
    share = steps.share(None, "finding revisited places")
    (found,) = steps.finish("same-places", lambda: (same_places(places, graph.first, share),))
    share(1)
    same = same_by_poses(found, first.poses, graph.first)
    return linked(graph, same, first.poses), same


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
