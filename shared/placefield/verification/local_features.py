"""The local features of an image, as they are kept."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SIDE = 480
"""Pixels of the longest side to which an image is resized first: all images are of one scale."""

SIFT_LENGTH = 128
"""Numbers of a descriptor of SIFT."""

MOST_NUMBERS = 512
"""The most numbers of a descriptor of a network."""


class LocalFeatures(NamedTuple):
    """The local features of an image, the strongest first.

    Attributes:
        points: (n, 2) float32, x and y from the middle of the image, as a fraction of its longest
            side.
        descriptors: (n, D) uint8, whose Euclidean distances count; D is 128 for SIFT.
    """

    points: NDArray[np.float32]
    descriptors: NDArray[np.uint8]


NO_FEATURES = LocalFeatures(np.empty((0, 2), np.float32), np.empty((0, SIFT_LENGTH), np.uint8))
"""Those of a uniform image, whatever D is."""
