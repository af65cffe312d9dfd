"""The stage from frame to raw feature, in place of ``DescriptorStage`` where there is no map."""

import hashlib
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from placefield.config import InferenceConfig
from placefield.errors import ConfigError
from placefield.features.calibration import Calibration, View
from placefield.features.descriptor_stage import large_frame
from placefield.features.descriptors import Moments, is_blank
from placefield.features.extract import feature_of, least_side_of, network_of
from placefield.features.kinds import FeatureKind, kinds_of

_DEFAULTS = InferenceConfig()

Array = NDArray[np.float32]


def raw_fingerprint(kind: FeatureKind, camera: Calibration | None = None) -> str:
    """Return the fingerprint that identifies a kind of feature, 16 hexadecimal digits.

    That of a network depends on its content; the network is read, but not loaded. It depends on the
    size at which images are decoded, too.

    Args:
        kind: of the feature.
        camera: whose view the frames are rectified to; None: they are used as they are.

    Raises:
        ConfigError: the kind has several parts, or a file of the network is missing or malformed.
    """
    check_one_part(kind)
    network = network_of(kind)
    named = f"raw {kind}".encode() if network is None else b"raw network " + network.digest
    named += f" {least_side_of(kind, network)}".encode()
    if camera is not None:
        named += b" of camera " + camera.model_dump_json().encode()
    return hashlib.sha256(named).hexdigest()[:16]


def check_one_part(kind: FeatureKind) -> None:
    """Refuse a feature of several parts.

    Raises:
        ConfigError: it has several.
    """
    if len(kinds_of(kind)) > 1:
        raise ConfigError(
            f"setting features.kind: {kind}: without a map frames have one feature: give one"
        )


class RawStage:
    """Describes frames by their raw features; all streams may share it."""

    standardises = False
    """Whether a descriptor depends on the frames before it."""

    large_frame = large_frame()
    """The shape of a large frame, to warm up with."""

    def __init__(
        self,
        kind: FeatureKind,
        view: View | None = None,
        inference: InferenceConfig = _DEFAULTS,
    ) -> None:
        """Load the feature of a kind, of frames that are rectified to a view if there is one.

        Raises:
            ConfigError: the kind has several parts, or see ``feature_of``.
        """
        check_one_part(kind)
        self.feature = replace(feature_of(kind, inference), view=view)
        """Describes frames by their raw features."""
        self.raw_dimensions = self.feature.widths if self.feature.describes_images else (None,)
        """The dimension of the only part; None: the frames are given descriptors."""

    def new_stream(self, moments: Moments | None = None) -> "RawStream":
        """Begin a stream, or continue one; raw features need no moments."""
        return RawStream()


class RawStream:
    """The raw features of one stream are its descriptors."""

    moments: Moments | None = None
    """It has none."""

    def update_raw(self, raw: Array) -> Array | None:
        """Return the raw feature (D,) float32 of the next frame; None if it is blank."""
        return None if is_blank(raw) else raw
