"""The stage from frame to descriptor: an image is decoded, described, standardised and reduced.

It knows no bus: the library and the featurizer both use it.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from placefield.features.descriptors import DescriptorModel, DescriptorStream, Moments
from placefield.features.extract import feature_of_model

Array = NDArray[np.float32]


class FrameStream(Protocol):
    """Describes the frames of one stream, in order."""

    @property
    def moments(self) -> Moments | None:
        """The moments of the stream so far; None if it has none."""

    def update(self, image: bytes | NDArray[np.uint8]) -> Array | None:
        """Return the descriptor of the next frame; None if the image is blank.

        Raises:
            FrameError: the image cannot be read.
        """


class FrameStage(Protocol):
    """What a featurizer describes images with; all its streams share it."""

    @property
    def standardises(self) -> bool:
        """Whether a descriptor depends on the frames before it."""

    def describe(self, image: bytes | NDArray[np.uint8]) -> Array:
        """Return the raw feature of an image.

        Raises:
            FrameError: the image cannot be read.
        """

    def new_stream(self, moments: Moments | None = None) -> FrameStream:
        """Begin a stream, or continue one whose moments so far are given."""


class DescriptorStage:
    """Describes images by a descriptor model; all streams may share it."""

    def __init__(self, model: DescriptorModel) -> None:
        """Load the feature of a map's descriptor model.

        Raises:
            ConfigError: OpenCV cannot run its network.
        """
        self._model = model
        self.standardises = model.follows_query
        """Whether a descriptor depends on the frames before it."""
        self._feature = feature_of_model(model)

    def describe(self, image: bytes | NDArray[np.uint8]) -> Array:
        """Return the raw feature (D,) float32 of an encoded image or pixels.

        Raises:
            FrameError: the image cannot be read.
        """
        return self._feature.describe(image)

    def new_stream(self, moments: Moments | None = None) -> "ImageStream":
        """Begin a stream, or continue one whose moments so far are given."""
        return ImageStream(self, DescriptorStream(self._model, moments))


class ImageStream:
    """Turns the images of one stream into descriptors, frame by frame and causally."""

    def __init__(self, stage: DescriptorStage, descriptors: DescriptorStream) -> None:
        """Combine the stage with the stream of descriptors of the raw features."""
        self._stage = stage
        self._descriptors = descriptors

    @property
    def moments(self) -> Moments:
        """The moments of the stream so far."""
        return self._descriptors.moments

    def update(self, image: bytes | NDArray[np.uint8]) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame: an encoded image, or pixels.

        A blank image gives None, see ``DescriptorStream``.

        Raises:
            FrameError: the image cannot be read; the stream is unchanged.
        """
        return self.update_raw(self._stage.describe(image))

    def update_raw(self, raw: Array) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame by its raw feature (D,) float32.

        A blank image gives None, see ``DescriptorStream``.

        Raises:
            FrameError: the feature has another shape, or is not finite; the stream is unchanged.
        """
        return self._descriptors.update(raw)
