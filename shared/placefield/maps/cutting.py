"""Cuts the first traverse of a map into segments of natural lengths, once per channel."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import MapError
from placefield.maps.build_steps import ONE_BY_ONE, Steps
from placefield.maps.trajectory import travelled
from placefield.maps.traverse import Traverse
from placefield.scales.channels import Channel, make_channels

Array = NDArray[np.float32]
Cut = Callable[[Array, Traverse, Config, Steps], tuple[Channel, ...]]
"""Called with the reference traverse's descriptors (K, N), the traverse itself, the settings and
how to carry out the steps."""


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
    min_scale, metres = lower_limit(traverse, config)
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


def lower_limit(traverse: Traverse, config: Config) -> tuple[float, NDArray[np.floating] | None]:
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
