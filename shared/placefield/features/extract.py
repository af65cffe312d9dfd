"""Raw features of images, by the kind of feature."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.config import ONNX, FeatureKind, InferenceConfig
from placefield.errors import FrameError
from placefield.features.descriptors import DescriptorModel
from placefield.features.gist import gist
from placefield.features.grayscale import grayscale
from placefield.features.images import pixels_of
from placefield.features.inference import NetworkFeature
from placefield.features.mask import Mask
from placefield.features.network import Network, read_network
from placefield.features.network_sandbox import try_network
from placefield.features.shrink import small_grey
from placefield.plugins import load_plugin

GIST_SIZE = 64  # pixels; 128 pixels were no better on the sample routes, and slower

_DEFAULTS = InferenceConfig()

Array = NDArray[np.float32]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Feature:
    """A feature, which describes images; threads may share it.

    Attributes:
        network: the network that it runs; None if it needs none.
        mask: hides a part of each image first; None: nothing is hidden.
    """

    network: Network | None
    _describe: Callable[[Pixels], Array]
    mask: Mask | None = None

    def describe(self, image: bytes | Pixels) -> Array:
        """Return the raw feature of an encoded image or of pixels, (D,) float32.

        Raises:
            FrameError: the image cannot be read, or has another aspect ratio than the mask.
        """
        pixels = pixels_of(image)
        return self._describe(pixels if self.mask is None else self.mask.apply(pixels))


def feature_of(kind: FeatureKind, inference: InferenceConfig = _DEFAULTS) -> Feature:
    """Return the feature of a kind; for ``onnx:FILE``, the network and its TOML are read.

    Raises:
        ConfigError: a file of the network is missing or malformed, onnxruntime cannot run the
            network (see ``try_network``), or no installed package has a feature of this name.
    """
    return _feature(kind, network_of(kind), inference)


def feature_of_model(model: DescriptorModel, inference: InferenceConfig = _DEFAULTS) -> Feature:
    """Return the feature that a descriptor model was fitted on, with the model's network and mask.

    Raises:
        ConfigError: onnxruntime cannot run the network (see ``try_network``), or the package with
            the feature is not installed.
    """
    return replace(_feature(model.kind, model.network, inference), mask=model.mask)


def network_of(kind: FeatureKind) -> Network | None:
    """Read the network of a kind of feature; None for a kind without a network.

    Raises:
        ConfigError: a file of the network is missing or malformed.
    """
    return read_network(Path(kind.removeprefix(ONNX))) if kind.startswith(ONNX) else None


def _feature(kind: FeatureKind, network: Network | None, inference: InferenceConfig) -> Feature:
    if network is not None:
        try_network(kind, network)
        return Feature(network, NetworkFeature(kind, network, inference).describe)
    built_in = {"grayscale": grayscale, "gist": _gist}.get(kind)
    return Feature(None, built_in or _of_plugin(kind))


def _of_plugin(kind: FeatureKind) -> Callable[[Pixels], Array]:
    """Return a feature of another package, with a check of the shape of its vectors."""
    describe = load_plugin("placefield.features", kind)

    def checked(pixels: Pixels) -> Array:
        raw = np.asarray(describe(pixels), np.float32)
        if raw.ndim != 1 or not len(raw):
            raise FrameError(f"feature {kind!r}: gives shape {raw.shape}; it must give (D,)")
        return raw

    return checked


def _gist(pixels: Pixels) -> Array:
    # The whole image is used: the authors' code crops the centre, which loses the street's sides.
    return gist(small_grey(pixels, GIST_SIZE, GIST_SIZE))


def default_dimensions(kind: FeatureKind) -> int:
    """Return the default number of dimensions that PCA keeps of a kind of feature."""
    return 500 if kind == "grayscale" else 300
