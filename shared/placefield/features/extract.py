"""Images to raw features, by the feature's kind."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from placefield.config import FeatureKind
from placefield.features.gist import DIMENSIONS as GIST_DIMENSIONS
from placefield.features.gist import gist
from placefield.features.grayscale import DIMENSIONS as GRAYSCALE_DIMENSIONS
from placefield.features.grayscale import grayscale
from placefield.features.images import decode, grey

GIST_SIZE = 64  # pixels; 128 measured no better on the sample routes, and takes longer


@dataclass(frozen=True)
class Kind:
    """One kind of feature.

    Attributes:
        describe: grey image (H, W) float32, 0 to 255, to its feature (raw_dimensions,) float32.
        raw_dimensions: before PCA.
        dimensions: after PCA, where the configuration gives none; as in the paper.
    """

    describe: Callable[[NDArray[np.float32]], NDArray[np.float32]]
    raw_dimensions: int
    dimensions: int


KINDS: dict[FeatureKind, Kind] = {
    "grayscale": Kind(grayscale, GRAYSCALE_DIMENSIONS, 500),
    "gist": Kind(partial(gist, size=GIST_SIZE), GIST_DIMENSIONS, 300),
}


def raw_feature(image: bytes | NDArray[np.uint8], kind: FeatureKind) -> NDArray[np.float32]:
    """Return the feature of an encoded image or of pixels, (raw_dimensions,) float32.

    Raises:
        FrameError: the image cannot be read.
    """
    pixels = decode(image) if isinstance(image, bytes) else image
    return KINDS[kind].describe(grey(pixels))
