"""The stage from frame to descriptor: an image is decoded, described, standardised and reduced.

A frame that is a given descriptor is standardised and reduced like the feature of an image.

It knows no bus: the library and the featurizer both use it.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from placefield.config import InferenceConfig
from placefield.features.descriptors import DescriptorStream, Moments
from placefield.features.extract import Feature, feature_of_model
from placefield.features.frames import Frame
from placefield.features.joined_model import AnyModel, JoinedStream
from placefield.features.mask import Mask

_DEFAULTS = InferenceConfig()

Array = NDArray[np.float32]


class FrameStream(Protocol):
    """Describes the frames of one stream, in order."""

    @property
    def moments(self) -> Moments | None:
        """The moments of the stream so far; None if it has none."""

    def update_raw(self, raw: Array) -> Array | None:
        """Return the descriptor of the next frame by its raw feature; None if it is blank.

        Raises:
            FrameError: the feature has another shape, or is not finite.
        """


class FrameStage(Protocol):
    """What a featurizer describes frames with; all its streams share it."""

    @property
    def feature(self) -> Feature:
        """Describes frames by their raw features."""

    @property
    def standardises(self) -> bool:
        """Whether a descriptor depends on the frames before it."""

    @property
    def raw_dimensions(self) -> tuple[int | None, ...]:
        """The dimension of each part of the raw features; None if a frame has to come first."""

    @property
    def large_frame(self) -> tuple[int, int, int]:
        """The shape of a large frame, to warm up with."""

    def new_stream(self, moments: Moments | None = None) -> FrameStream:
        """Begin a stream, or continue one whose moments so far are given."""


def large_frame(mask: Mask | None = None) -> tuple[int, int, int]:
    """Return the shape of a large frame of colour, 25 MB, which fits the mask if there is one."""
    rows, columns = (9, 16) if mask is None else mask.used.shape
    return round(3840 * rows / columns), 3840, 3


def warm_up(stage: FrameStage) -> None:
    """Describe a frame of no stream, so that everything is loaded and compiled before serving.

    Given descriptors need nothing of that.

    The frame is large: glibc keeps as much memory for later frames as the largest block that was
    freed. Otherwise each frame would have to map its pages again.
    """
    if not stage.feature.describes_images:
        return
    frame = np.zeros(stage.large_frame, np.uint8)
    stage.feature.describe(frame)
    frame.flags.writeable = False  # as frames of pixels come from the bus
    stage.feature.describe(frame)


class DescriptorStage:
    """Describes frames by a descriptor model; all streams may share it."""

    def __init__(self, model: AnyModel, inference: InferenceConfig = _DEFAULTS) -> None:
        """Load the feature of a map's descriptor model; a network runs where ``inference`` says.

        Raises:
            ConfigError: onnxruntime cannot run its network.
        """
        self._model = model
        self.standardises = model.follows_query
        """Whether a descriptor depends on the frames before it."""
        self.raw_dimensions = tuple(part.raw_dimensions for part in model.parts)
        """The dimension of each part of the raw features."""
        self.large_frame = large_frame(model.mask)
        """The shape of a large frame, to warm up with."""
        self.feature = feature_of_model(model, inference)
        """Describes frames by their raw features."""

    def new_stream(self, moments: Moments | None = None) -> "ImageStream":
        """Begin a stream, or continue one whose moments so far are given."""
        return ImageStream(self.feature, self._model.new_stream(moments))


class ImageStream:
    """Turns the images of one stream into descriptors, frame by frame and causally."""

    def __init__(self, feature: Feature, descriptors: DescriptorStream | JoinedStream) -> None:
        """Combine the feature with the stream of descriptors of the raw features."""
        self._feature = feature
        self._descriptors = descriptors

    @property
    def moments(self) -> Moments:
        """The moments of the stream so far."""
        return self._descriptors.moments

    def update(self, image: bytes | NDArray[np.uint8]) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame: an encoded image, or pixels.

        If the map has a view, the image is of this view. A blank image gives None, see
        ``DescriptorStream``.

        Raises:
            FrameError: the image cannot be read; the stream is unchanged.
        """
        return self.update_raw(self._feature.describe(image))

    def update_frame(self, frame: Frame) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame: of its image or its descriptor.

        A blank frame gives None, see ``DescriptorStream``.

        Raises:
            FrameError: the frame cannot be read, or is not what the map takes; the stream is
                unchanged.
        """
        return self.update_raw(self._feature.of_frame(frame))

    def update_raw(self, raw: Array) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame by its raw feature (D,) float32.

        A blank image gives None, see ``DescriptorStream``.

        Raises:
            FrameError: the feature has another shape, or is not finite; the stream is unchanged.
        """
        return self._descriptors.update(raw)
