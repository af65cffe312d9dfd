"""The input of every method: a drive of a query along a reference."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from placefield.baselines.multiscale import SCALES, fixed_scale_channels
from placefield.config import Config, MatchingConfig, Rule
from placefield.errors import MapError
from placefield.evaluation.truth import Truth
from placefield.features.joined_model import FeaturePart
from placefield.maps.build import build_map
from placefield.maps.cutting import Cut, adaptive_channels
from placefield.maps.map import Map, MapChannel
from placefield.maps.map_metrics import identity_metric
from placefield.maps.traverse import Traverse
from placefield.matching.comparing import distance_matrix
from placefield.presets import PRESETS
from placefield.scales.channels import Channel
from placefield_tools.common.progress import CONSOLE
from placefield_tools.evaluate.drive_matching import Descriptors, Metres, descriptors_of
from placefield_tools.evaluate.truth_source import TruthSource
from placefield_tools.study.describing import Described

Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Trial:
    """A drive of Q frames along a reference of K frames.

    Attributes:
        config: whose matching says which way the route is driven.
        traverse: the reference.
        parts: of its feature, see ``Feature.parts``.
        placemap: our map of it.
        plain: a channel of our map under the identity metric.
        reference: its frames.
        query: the driven frames.
        descriptors: Q descriptors (N,) float32 of the frames, None for a missing one.
        metres: of the drive, and of the places.
        truth: of the driven frames.
        ground: by what that is known.
        jumps: (J,) int64, positions in the drive of the first frame after a jump.
        every: n of a protocol that takes every n-th frame; None: it is none.
        lowered_min_scale: shortest segment of all our maps, places, where the thinned reference is
            too short for the one asked for, so that the configuration has this one.
    """

    config: Config
    traverse: Traverse
    parts: Sequence[FeaturePart]
    placemap: Map
    plain: MapChannel
    reference: Described
    query: Described
    descriptors: Descriptors
    metres: Metres
    truth: Truth
    ground: TruthSource
    jumps: NDArray[np.int64]
    every: int | None = None
    lowered_min_scale: int | None = None

    @property
    def places(self) -> int:
        """K."""
        return self.placemap.places.count

    @cached_property
    def distances(self) -> Array:
        """Distances of the frames to the places without a metric, (Q, K); 0 if not observed."""
        return distance_matrix(self.plain.metric, self.descriptors, 0)

    @cached_property
    def published(self) -> Map:
        """The map of AMS by the preset ``paper``.

        Raises:
            MapError: the reference is too short for it.
        """
        if self.config.preset == "paper":
            return self.placemap
        return self.build(as_published(self.config))

    @cached_property
    def multiscale(self) -> Map:
        """The map of MS as published, with the scales that the reference is long enough for.

        Raises:
            MapError: it is too short for any.
        """
        config = as_published(self.config)
        smallest = {"min_scale": min(SCALES), "min_scale_metres": 0.0}
        scales = config.scales.model_copy(update=smallest)
        return self.build(config.model_copy(update={"scales": scales}), _fixed_scales)

    def on_published(self, placemap: Map) -> "Trial":
        """Return the same drive by the preset ``paper``, on another map of the reference."""
        return replace(
            self,
            config=as_published(self.config),
            placemap=placemap,
            plain=plain_channel(placemap, self.traverse),
            descriptors=descriptors_of(placemap.model, self.query.raws),
            metres=replace(self.metres, placemap=placemap),
        )

    def build(self, config: Config, cut: Cut = adaptive_channels) -> Map:
        """Build another map of the reference; see ``build_map``."""
        return build_reference(self.traverse, config, self.parts, cut)

    def matching(self, rule: Rule) -> MatchingConfig:
        """Return how to match by a rule."""
        return self.config.matching.model_copy(update={"rule": rule})


def build_reference(
    traverse: Traverse, config: Config, parts: Sequence[FeaturePart], cut: Cut = adaptive_channels
) -> Map:
    """Build a map of one traverse.

    Raises:
        MapError: see ``build_map``.
    """
    return build_map([traverse], config, cut=cut, parts=parts)


def as_published(config: Config) -> Config:
    """Return the same with the settings of the preset ``paper``, if they are not in it already."""
    if config.preset == "paper":
        return config
    sections = {
        name: getattr(config, name).model_copy(update=dict(settings))
        for name, settings in PRESETS["paper"].items()
    }
    return config.model_copy(update={"preset": "paper", **sections})


def plain_channel(placemap: Map, traverse: Traverse) -> MapChannel:
    """Return a channel of a map under the identity metric."""
    metric = identity_metric(placemap.model.of_reference(traverse.raw))
    return replace(placemap.channels[0], metric=metric)


def fixed_map(trial: Trial) -> Map | None:
    """Return the map of MS; None, with a line that says why, where the reference is too short."""
    try:
        return trial.multiscale
    except MapError as error:
        CONSOLE.print(f"no MS: {error}", soft_wrap=True)
        return None


def _fixed_scales(descriptors: Array, *_: object) -> tuple[Channel, ...]:
    places = len(descriptors)
    fitting = [scale for scale in SCALES if 2 * scale + scale // 2 <= places]
    return fixed_scale_channels(places, fitting or SCALES)
