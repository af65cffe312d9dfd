"""What extracts the local features of the images of one map: SIFT, or a network."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.config import BuildConfig, InferenceConfig
from placefield.errors import ConfigError
from placefield.features.kinds import ONNX
from placefield.features.network import read_onnx
from placefield.verification.extracting import extract
from placefield.verification.local_features import LocalFeatures
from placefield.verification.local_network import LocalNetwork, try_local_network
from placefield.verification.place_features import PlaceFeatures

_DEFAULTS = InferenceConfig()


@dataclass(frozen=True)
class Extractor:
    """Extracts the local features of images; threads may share it.

    Attributes:
        most: local features of an image.
        network: that gives them; None: SIFT does.
    """

    most: int
    network: LocalNetwork | None = None

    @property
    def onnx(self) -> NDArray[np.uint8] | None:
        """The file of the network, (bytes,) uint8; None: SIFT needs none."""
        return None if self.network is None else self.network.onnx

    def extract(self, pixels: NDArray[np.uint8]) -> LocalFeatures:
        """Return the strongest local features of an image (H, W) grey or (H, W, 3) BGR.

        Raises:
            FrameError: the pixels are of another shape or dtype, or the network fails on them.
        """
        if self.network is None:
            return extract(pixels, self.most)
        return self.network.extract(pixels, self.most)


def extractor_of(build: BuildConfig, inference: InferenceConfig = _DEFAULTS) -> Extractor | None:
    """Return the extractor of a new map; None if it keeps no local features.

    Raises:
        ConfigError: the network cannot be read or gives no local features (see ``LocalNetwork``),
            or it is given although the map keeps none.
    """
    kind = build.local_feature
    if not build.local_features:
        if kind.startswith(ONNX):
            raise ConfigError(
                "setting build.local_feature: also give build.local_features, their number; 300 "
                "to 600 are enough"
            )
        return None
    onnx = read_onnx(Path(kind.removeprefix(ONNX))) if kind.startswith(ONNX) else None
    return Extractor(build.local_features, _loaded(kind, onnx, inference))


def extractor_of_places(places: PlaceFeatures, inference: InferenceConfig = _DEFAULTS) -> Extractor:
    """Return the extractor that gave the local features of a map's places.

    Raises:
        ConfigError: the map's network cannot run, or gives other descriptors than the map has.
    """
    network = _loaded("the map's network of local features", places.onnx, inference)
    numbers = places.descriptors.shape[1]
    if network is not None and len(places.points) and network.numbers != numbers:
        raise ConfigError(
            f"the map's network of local features: gives descriptors of {network.numbers} numbers, "
            f"and those of the places have {numbers}; build the map again"
        )
    return Extractor(places.most, network)


def _loaded(
    name: str, onnx: NDArray[np.uint8] | None, inference: InferenceConfig
) -> LocalNetwork | None:
    if onnx is None:
        return None
    try_local_network(name, onnx)
    return LocalNetwork(name, onnx, inference)
