"""The stage from frame to descriptor: an image is decoded, described, standardised and reduced.

With no bus: a library and a featurizer compose it alike.
"""

import numpy as np
from numpy.typing import NDArray

from placefield.features.descriptors import DescriptorModel, DescriptorStream, Moments
from placefield.features.extract import feature_of_model

Array = NDArray[np.float32]


class DescriptorStage:
    """Describes images as a descriptor model has it; all streams may share it."""

    def __init__(self, model: DescriptorModel) -> None:
        """Take the model of a map.

        Raises:
            ConfigError: OpenCV cannot run its network.
        """
        self._model = model
        self._feature = feature_of_model(model)

    def describe(self, image: bytes | NDArray[np.uint8]) -> Array:
        """Return the raw feature (D,) float32 of an encoded image or pixels; of no stream.

        Raises:
            FrameError: the image cannot be read.
        """
        return self._feature.describe(image)

    def new_stream(self, moments: Moments | None = None) -> "ImageStream":
        """Begin a stream, or go on with one that has had these moments."""
        return ImageStream(self, DescriptorStream(self._model, moments))


class ImageStream:
    """Makes the images of one stream into descriptors, frame by frame, looking back only."""

    def __init__(self, stage: DescriptorStage, descriptors: DescriptorStream) -> None:
        """Take the stage, and what makes the raw features of the stream into descriptors."""
        self._stage = stage
        self._descriptors = descriptors

    @property
    def moments(self) -> Moments:
        """Of the stream so far."""
        return self._descriptors.moments

    def update(self, image: bytes | NDArray[np.uint8]) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame: an encoded image, or pixels.

        None where there was nothing to see, see ``DescriptorStream``.

        Raises:
            FrameError: the image cannot be read; the stream is as it was.
        """
        return self.update_raw(self._stage.describe(image))

    def update_raw(self, raw: Array) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame by its raw feature (D,) float32.

        None where there was nothing to see, see ``DescriptorStream``.

        Raises:
            FrameError: the feature is of another shape, or not finite; the stream is as it was.
        """
        return self._descriptors.update(raw)
