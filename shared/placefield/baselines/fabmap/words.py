"""The visual words of a frame: its SIFT descriptors, each by the nearest centre of a vocabulary."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans, vq

from placefield.errors import MapError

# Frames are resized to one width: else small ones would have few keypoints, and large ones so many
# that each frame would have most words.
_WIDTH = 320  # pixels

_FROM_FRAME, _PER_WORD = 200, 30  # most descriptors for the vocabulary, per frame and per word
_CONVERGED = 1.0  # change of the mean distance to the nearest centre, which is some 250

_NO_DESCRIPTORS: NDArray[np.float32] = np.empty((0, 128), np.float32)


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """W visual words.

    Attributes:
        centres: (W, 128) float32, SIFT descriptors.
    """

    centres: NDArray[np.float32]

    def observe(self, image: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which words a grey image (H, W) uint8 has, (W,) bool; none without keypoints."""
        observed = np.zeros(len(self.centres), np.bool_)
        descriptors = _sift(image)
        if len(descriptors):
            nearest, _ = vq(descriptors, self.centres)
            observed[nearest] = True
        return observed


def learn_words(images: Iterable[NDArray[np.uint8]], words: int, seed: int) -> Vocabulary:
    """Learn a vocabulary by k-means of SIFT descriptors sampled from the reference's frames.

    A frame should have no more than some 15 % of the words: on the sample routes, with 100 to 700
    keypoints per frame, 1500 to 2000 words did better than 500.

    Args:
        images: grey, (H, W) uint8 each.
        words: W, at least 1; there are fewer if the frames have fewer different descriptors.
        seed: of the sample.

    Raises:
        MapError: no image has a keypoint.
    """
    rng = np.random.default_rng(seed)
    drawn = [rng.permutation(_sift(image))[:_FROM_FRAME] for image in images]
    descriptors = rng.permutation(np.concatenate([_NO_DESCRIPTORS, *drawn]))[: _PER_WORD * words]
    if not len(descriptors):
        raise MapError(
            "the reference's frames show no keypoint: FAB-MAP needs frames that are not uniform"
        )
    centres, _ = kmeans(descriptors, descriptors[:words], thresh=_CONVERGED)
    return Vocabulary(np.asarray(centres, np.float32))


def _sift(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    height, width = image.shape
    shrinks = width > _WIDTH
    resized = cv2.resize(
        image,
        (_WIDTH, max(round(height * _WIDTH / width), 1)),
        interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC,
    )
    _, descriptors = cv2.SIFT.create().detectAndCompute(resized, None)
    return _NO_DESCRIPTORS if descriptors is None else np.asarray(descriptors, np.float32)
