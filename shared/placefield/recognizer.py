"""Place recognition in one object, without a bus: frames in, matches out."""

import math

import numpy as np
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import FrameError
from placefield.features.descriptor_stage import DescriptorStage
from placefield.features.frames import Frame
from placefield.features.images import Image, check_pixels, load
from placefield.fusion.fused_stream import FusedStream
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match, SmoothedMatch
from placefield.maps.map import Map
from placefield.matching.channel_stage import ChannelStage

_DEFAULTS = Config()


class Recognizer:
    """Recognises the places of a map in one stream of frames.

    It runs the same three stages as featurizer, channels and fuser together, and returns the same
    matches for the same frames: one at once, and a smoothed one after some later frames.
    """

    def __init__(self, placemap: Map, config: Config = _DEFAULTS) -> None:
        """Begin a stream on a map.

        Args:
            placemap: whose places are recognised.
            config: only the sections ``matching`` and ``inference`` count; the map has the rest.

        Raises:
            ConfigError: the rule cannot use the map's descriptors, or its routes.
        """
        placemap.features.check_rule(config.matching.rule)
        matching = config.matching
        self._map, self._rule = placemap, matching.rule
        self._model = placemap.model
        self._stage = DescriptorStage(placemap.model, config.inference)
        self._images = self._stage.new_stream()
        channels = dict(enumerate(placemap.channels))
        topology = placemap.topology
        self._channels = ChannelStage(channels, matching, topology=topology)
        fusion = FusionStage(topology, matching, placemap.places.pose)
        self._stream = FusedStream(self._channels, fusion, [matching.lag])

    def __repr__(self) -> str:
        return f"Recognizer({self._map!r}, rule {self._rule}, after {self._stream.frames} frames)"

    def update(self, image: Image, odometry_m: float | None = None) -> Match:
        """Match the next frame.

        Args:
            image: an encoded image, pixels (H, W) or (H, W, 3) BGR uint8, or a file. An image that
                does not decode is matched as a missing observation.
            odometry_m: the vehicle's odometry, metres travelled since any fixed start; None: no
                reading since the frame before.

        Raises:
            SourceError: the file cannot be read, or this is no image at all; nothing was matched.
            FrameError: pixels are of another shape or dtype, the odometry is below 0 or not
                finite, or the map is of descriptors or of a camera's view; nothing was matched.
        """
        _check_odometry(odometry_m)
        if not self._stage.feature.describes_images:
            raise FrameError("an image, but the map is of descriptors: give them to update_raw()")
        if self._model.view is not None:
            raise FrameError(
                "an image of an unknown camera, but the map is of a camera's view: give a Frame "
                "with its calibration to update_frame()"
            )
        loaded = load(image)
        if not isinstance(loaded, bytes):
            check_pixels(loaded)
        try:
            descriptor = self._images.update(loaded)
        except FrameError:
            descriptor = None
        return self.update_descriptor(descriptor, odometry_m)

    def update_frame(self, frame: Frame) -> Match:
        """Match the next frame of a source by its image or its descriptor, and its odometry.

        A frame that cannot be read, or is not what the map takes, is a missing observation.

        Raises:
            FrameError: the odometry is below 0 or not finite; nothing was matched.
        """
        _check_odometry(frame.odometry_m)
        try:
            descriptor = self._images.update_frame(frame)
        except FrameError:
            descriptor = None
        return self.update_descriptor(descriptor, frame.odometry_m)

    def update_raw(self, raw: NDArray[np.float32] | None, odometry_m: float | None = None) -> Match:
        """Match the next frame by its raw feature (D,); None is a missing observation.

        With a map of descriptors, that is the frame's descriptor as it was given.

        Raises:
            FrameError: the feature is of another shape, or not finite, or the odometry is below 0
                or not finite; no frame was matched.
        """
        _check_odometry(odometry_m)
        descriptor = None if raw is None else self._images.update_raw(raw)
        return self.update_descriptor(descriptor, odometry_m)

    def update_descriptor(
        self, descriptor: NDArray[np.float32] | None, odometry_m: float | None = None
    ) -> Match:
        """Match the next frame by its descriptor (N,); None is a missing observation.

        Raises:
            FrameError: the descriptor is of another shape, or its length is neither 1 nor 0 (which
                is a missing observation), or the odometry is below 0 or not finite; no frame was
                matched.
        """
        _check_odometry(odometry_m)
        observed = None if descriptor is None else self._model.checked(descriptor)
        compared = None if observed is None else next(self._channels.compare([observed]))
        return self._stream.update(compared, odometry_m)

    def smoothed(self) -> list[SmoothedMatch]:
        """Return the smoothed matches that are new since the last call.

        Every frame has one, in order, at most ``lag`` frames later, or when the stream is finished.
        """
        return self._stream.smoothed()

    def finish(self) -> list[SmoothedMatch]:
        """Return the remaining smoothed matches: the stream is over."""
        self._stream.finish()
        return self._stream.smoothed()


def _check_odometry(metres: float | None) -> None:
    """Refuse a reading that services would refuse from the bus.

    Raises:
        FrameError: it is below 0 or not finite.
    """
    if metres is not None and not 0 <= metres < math.inf:
        raise FrameError(f"odometry of {metres} m: give a distance of 0 or more, or none")
