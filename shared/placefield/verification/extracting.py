"""Extracts the local features of an image: SIFT keypoints with RootSIFT descriptors, as bytes.

RootSIFT (Arandjelović and Zisserman, 2012) is the square root of SIFT's histogram at unit sum. Its
Euclidean distance is the Hellinger distance of the histograms.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.features.images import check_pixels
from placefield.verification.local_features import NO_FEATURES, SIDE, LocalFeatures

_CONTRAST = 0.01  # a quarter of SIFT's own threshold: at night there is little contrast
_UNIT = 512.0  # of a descriptor's length, so that nearly all of its numbers fit a byte


def extract(pixels: NDArray[np.uint8], count: int) -> LocalFeatures:
    """Return the strongest local features of an image.

    Args:
        pixels: (H, W) grey or (H, W, 3) BGR, uint8.
        count: the most of them.

    Raises:
        FrameError: the pixels are of another shape or dtype, or there are none.
    """
    check_pixels(pixels)
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    height, width = grey.shape
    scale = SIDE / max(height, width)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    smaller = scale < 1
    resized = cv2.resize(grey, size, interpolation=cv2.INTER_AREA if smaller else cv2.INTER_CUBIC)
    sift = cv2.SIFT.create(count, contrastThreshold=_CONTRAST)
    found, described = sift.detectAndCompute(resized, None)
    if described is None:
        return NO_FEATURES
    # The same keypoint may come with several orientations, and ties make more than asked for.
    order = np.argsort([-keypoint.response for keypoint in found], kind="stable")[:count]
    points = np.array([found[number].pt for number in order], np.float32)
    middle = (np.array(size, np.float32) - 1) / 2
    root = np.sqrt(described[order] / np.maximum(described[order].sum(axis=1, keepdims=True), 1))
    stored = np.clip(np.rint(_UNIT * root), 0, 255).astype(np.uint8)
    return LocalFeatures(((points - middle) / SIDE).astype(np.float32), stored)
