"""What the evaluation needs of each frame of a query."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.config import InferenceConfig
from placefield.features.extract import feature_of_model
from placefield.features.frames import Frame
from placefield.features.rectification import image_of
from placefield.maps.map import Map
from placefield.verification.extractor import extractor_of_places
from placefield.verification.local_features import LocalFeatures
from placefield.verification.verification_stage import local_features_of


class Observed(NamedTuple):
    """A frame's raw feature (D,), and its local features if the map has some."""

    raw: NDArray[np.float32]
    local_features: LocalFeatures | None


def observer(placemap: Map, inference: InferenceConfig) -> Callable[[Frame], Observed]:
    """Return a function that observes a frame; it raises FrameError if the frame cannot be read.

    Args:
        placemap: its feature describes the frame, with its view and its mask.
        inference: where a network runs.

    Raises:
        ConfigError: a network of the map cannot run, see ``feature_of_model`` and
            ``extractor_of_places``.
    """
    feature, places = feature_of_model(placemap.model, inference), placemap.local_features
    extractor = None if places is None else extractor_of_places(places, inference)

    def observe(frame: Frame) -> Observed:
        raw, local = feature.of_frame(frame), None
        if extractor is not None and frame.descriptor is None:
            pixels = image_of(frame, placemap.model.view)
            local = local_features_of(placemap, extractor, pixels)
        return Observed(raw, local)

    return observe
