"""The stage from frame to raw feature, in place of ``DescriptorStage`` where there is no map."""

import hashlib

import numpy as np
from numpy.typing import NDArray

from placefield.config import DESCRIPTOR, FeatureKind, InferenceConfig
from placefield.features.descriptor_stage import large_frame
from placefield.features.descriptors import Moments, is_blank
from placefield.features.extract import feature_of
from placefield.features.frames import GivenDescriptor

_DEFAULTS = InferenceConfig()

Array = NDArray[np.float32]


class RawStage:
    """Describes frames by their raw features; all streams may share it."""

    standardises = False
    """Whether a descriptor depends on the frames before it."""

    large_frame = large_frame()
    """The shape of a large frame, to warm up with."""

    def __init__(self, kind: FeatureKind, inference: InferenceConfig = _DEFAULTS) -> None:
        """Load the feature of a kind.

        Raises:
            ConfigError: see ``feature_of``.
        """
        self._feature = feature_of(kind, inference)
        self.describes_images = kind != DESCRIPTOR
        """Whether frames are images; if not, they are given descriptors."""
        network = self._feature.network
        named = f"raw {kind}".encode() if network is None else b"raw network " + network.digest
        self.fingerprint = hashlib.sha256(named).hexdigest()[:16]
        """Identifies the feature, 16 hexadecimal digits."""

    def describe(self, image: bytes | NDArray[np.uint8]) -> Array:
        """Return the raw feature (D,) float32 of an encoded image or pixels.

        Raises:
            FrameError: the image cannot be read.
        """
        return self._feature.describe(image)

    def accept(self, descriptor: GivenDescriptor) -> Array:
        """Return the raw feature (D,) float32 of a frame that is a given descriptor.

        Raises:
            FrameError: frames are images.
        """
        return self._feature.accept(descriptor)

    def new_stream(self, moments: Moments | None = None) -> "RawStream":
        """Begin a stream, or continue one; raw features need no moments."""
        return RawStream(self)


class RawStream:
    """Turns the images of one stream into raw features."""

    moments: Moments | None = None
    """It has none."""

    def __init__(self, stage: RawStage) -> None:
        """Describe with this stage."""
        self._stage = stage

    def update(self, image: bytes | NDArray[np.uint8]) -> Array | None:
        """Return the raw feature (D,) float32 of the next frame; None if the image is blank.

        Raises:
            FrameError: the image cannot be read.
        """
        return self.update_raw(self._stage.describe(image))

    def update_raw(self, raw: Array) -> Array | None:
        """Return the raw feature (D,) float32 of the next frame; None if it is blank."""
        return None if is_blank(raw) else raw
