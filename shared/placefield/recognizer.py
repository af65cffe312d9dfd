"""All of recognition in one object, with no bus: frame in, match out."""

import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig
from placefield.errors import FrameError
from placefield.features.descriptors import DescriptorStream, checked
from placefield.features.extract import feature_of_model
from placefield.features.images import Image, check_pixels, load
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.maps.map import Map, MapMetric
from placefield.matching.channel_matcher import matcher_of
from placefield.matching.comparing import Comparison, MetricPlaces

_DEFAULTS = MatchingConfig()


class Recognizer:
    """Recognises the places of a map in one stream of frames.

    It does what featurizer, channels and fuser do together, and gives, frame for frame, what they
    give on the same frames.
    """

    def __init__(self, placemap: Map, config: MatchingConfig = _DEFAULTS) -> None:
        """Begin a stream on a map, with the rule of a configuration."""
        self._feature = feature_of_model(placemap.model)
        self._dimensions = len(placemap.model.components)
        self._config = config
        self._descriptors = DescriptorStream(placemap.model)
        self._places = {
            metric: MetricPlaces(metric, exact=config.compares_exactly)
            for metric in placemap.metrics
        }
        self._matchers = [
            (channel.metric, matcher_of(channel, config.rule, reverse=config.reverse))
            for channel in placemap.channels
        ]

    def push(self, image: Image) -> Match:
        """Match the next frame: an encoded image, pixels (H, W) or (H, W, 3) BGR uint8, or a file.

        An image that does not decode is matched as a frame that was not seen.

        Raises:
            SourceError: the file cannot be read, or this is no image at all; nothing was matched.
            FrameError: pixels are of another shape or dtype; nothing was matched.
        """
        shown = load(image)
        if not isinstance(shown, bytes):
            check_pixels(shown)
        try:
            raw = self._feature.describe(shown)
        except FrameError:
            raw = None
        return self.push_raw(raw)

    def push_raw(self, raw: NDArray[np.float32] | None) -> Match:
        """Match the next frame by its raw feature (D,); None is a frame that was not seen.

        Raises:
            FrameError: the feature is of another shape, or not finite; no frame was matched.
        """
        descriptor = None if raw is None else self._descriptors.push(raw)
        return self.push_descriptor(descriptor)

    def push_descriptor(self, descriptor: NDArray[np.float32] | None) -> Match:
        """Match the next frame by its descriptor (N,); None is a frame that was not seen.

        Raises:
            FrameError: the descriptor is of another shape, or its length neither 1 nor 0, where
                there was nothing to see; no frame was matched.
        """
        frames: dict[MapMetric, Comparison | None] = dict.fromkeys(self._places)
        seen = None if descriptor is None else checked(descriptor, self._dimensions)
        if seen is not None:
            for metric, places in self._places.items():
                (frames[metric],) = places.compare(seen[None])
        candidates = [matcher.push(frames[metric]) for metric, matcher in self._matchers]
        return fuse(candidates, self._config)
