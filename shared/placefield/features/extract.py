"""Images to raw features, by the feature's kind."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.config import ONNX, FeatureKind
from placefield.errors import FrameError
from placefield.features.descriptors import DescriptorModel
from placefield.features.gist import gist
from placefield.features.grayscale import grayscale
from placefield.features.images import pixels_of
from placefield.features.inference import NetworkFeature
from placefield.features.network import Network, read_network
from placefield.features.network_sandbox import try_network
from placefield.features.shrink import small_grey
from placefield.plugins import load_plugin

GIST_SIZE = 64  # pixels; 128 measured no better on the sample routes, and takes longer

Array = NDArray[np.float32]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Feature:
    """A way to describe images; threads may share it.

    Attributes:
        network: that it runs; None for the features that need none.
    """

    network: Network | None
    _describe: Callable[[Pixels], Array]

    def describe(self, image: bytes | Pixels) -> Array:
        """Return the raw feature of an encoded image or of pixels, (D,) float32.

        Raises:
            FrameError: the image cannot be read.
        """
        return self._describe(pixels_of(image))


def feature_of(kind: FeatureKind) -> Feature:
    """Return the feature of a kind; ``onnx:FILE`` reads the network and its TOML.

    Raises:
        ConfigError: a file of the network is missing or malformed, or OpenCV cannot run it, see
            ``try_network``; or no package brings a feature of another name.
    """
    return _feature(kind, network_of(kind))


def feature_of_model(model: DescriptorModel) -> Feature:
    """Return the feature that a descriptor model was fitted on; a network is the model's own.

    Raises:
        ConfigError: OpenCV cannot run the network, see ``try_network``; or the package that brought
            the feature is gone.
    """
    return _feature(model.kind, model.network)


def network_of(kind: FeatureKind) -> Network | None:
    """Read the network that a kind names; None for the kinds that need none.

    Raises:
        ConfigError: a file of the network is missing or malformed.
    """
    return read_network(Path(kind.removeprefix(ONNX))) if kind.startswith(ONNX) else None


def _feature(kind: FeatureKind, network: Network | None) -> Feature:
    if network is not None:
        try_network(kind, network)
        return Feature(network, NetworkFeature(kind, network).describe)
    built_in = {"grayscale": grayscale, "gist": _gist}.get(kind)
    return Feature(None, built_in or _of_plugin(kind))


def _of_plugin(kind: FeatureKind) -> Callable[[Pixels], Array]:
    """Return a feature of another package, whose vectors are looked at before they are believed."""
    describe = load_plugin("placefield.features", kind)

    def checked(pixels: Pixels) -> Array:
        raw = np.asarray(describe(pixels), np.float32)
        if raw.ndim != 1 or not len(raw):
            raise FrameError(f"feature {kind!r}: gives shape {raw.shape}; it must give (D,)")
        return raw

    return checked


def _gist(pixels: Pixels) -> Array:
    # The authors' code crops the centre; on a route that would lose the sides of the street.
    return gist(small_grey(pixels, GIST_SIZE, GIST_SIZE))


def default_dimensions(kind: FeatureKind) -> int:
    """Return how many dimensions PCA leaves of a feature, where the configuration does not say."""
    return 500 if kind == "grayscale" else 300
