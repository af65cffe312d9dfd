"""SeqSLAM: patch-normalised images, local contrast, straight trajectories.

M. Milford and G. Wyeth, "SeqSLAM: Visual route-based navigation for sunny summer days and stormy
winter nights", ICRA 2012; parameters and the measure of certainty as in OpenSeqSLAM2 (B. Talbot, S.
Garg, M. Milford, IROS 2018). In OpenSeqSLAM and OpenSeqSLAM2, trajectories are centred on the
matched query frame, so they use later frames for half of their length. Here they do so as far as a
lag allows; without a lag they end at the newest query frame.
"""

import math
from dataclasses import dataclass
from functools import reduce

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from placefield.baselines.fixed_window import window_sums
from placefield.errors import ConfigError
from placefield.fusion.match import Match
from placefield.matching.candidate import UNANSWERED

WIDTH, HEIGHT = 64, 32

_LEAST_SUM = 1e-6  # so that a sum of 0, as of a frame with itself, still has a ratio


@dataclass(frozen=True)
class SeqSlam:
    """SeqSLAM's parameters, as published.

    Attributes:
        patch: side of the square patches that are normalised, pixels.
        contrast_window: R, places whose differences are contrasted; 0 leaves them as they are.
        length: d_s, query frames of a trajectory.
        speeds: of the trajectories, places per query frame.
        neighbourhood_window: R_window, places around the match that its uniqueness disregards.
    """

    patch: int = 8
    contrast_window: int = 10
    length: int = 15
    speeds: tuple[float, ...] = (0.8, 0.9, 1.0, 1.1, 1.2)
    neighbourhood_window: int = 10


PUBLISHED = SeqSlam()


def seqslam_image(grey: NDArray[np.float32]) -> NDArray[np.float32]:
    """Resize a grey image (H, W) float32, 0 to 255, to (32, 64) float32."""
    small = cv2.resize(grey, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)


def seqslam(
    reference: NDArray[np.float32],
    query: NDArray[np.float32],
    settings: SeqSlam = PUBLISHED,
    lag: int = 0,
) -> list[Match]:
    """Match a query traverse to a reference traverse.

    Args:
        reference: (K, H, W) float32, grey images in route order, as of ``seqslam_image``.
        query: (Q, H, W) float32.
        settings: SeqSLAM's parameters.
        lag: see ``match_sequences``.

    Returns:
        Q matches, see ``match_sequences``.

    Raises:
        ConfigError: the patches do not tile the images.
    """
    return match_sequences(image_differences(reference, query, settings.patch), settings, lag)


def image_differences(
    reference: NDArray[np.float32], query: NDArray[np.float32], patch: int
) -> NDArray[np.float32]:
    """Return the mean absolute difference of patch-normalised images, (Q, K) float32.

    Args:
        reference: (K, H, W) float32.
        query: (Q, H, W) float32.
        patch: side of a patch, pixels.

    Raises:
        ConfigError: the patches do not tile the images.
    """
    frames, places = _normalise_patches(query, patch), _normalise_patches(reference, patch)
    return np.asarray(cdist(frames, places, "cityblock") / places.shape[1], np.float32)


def match_sequences(
    differences: NDArray[np.float32], settings: SeqSlam = PUBLISHED, lag: int = 0
) -> list[Match]:
    """Match each query frame by the trajectory through it with the lowest sum of differences.

    A trajectory is d_s query frames long and passes the places at one of the speeds. Without a lag
    it ends at the matched frame; a lag of d_s // 2 or more centres it on that, as published. There
    is no match where no trajectory is complete.

    Args:
        differences: (Q, K) float32, of query frames to places.
        settings: SeqSLAM's parameters.
        lag: how many frames after the matched one a trajectory may look at, at least 0.

    Returns:
        Q matches. The score is the uniqueness: the lowest sum outside the match's neighbourhood
        over the match's own, 1 where nothing is outside.
    """
    window = settings.contrast_window
    contrasted = _enhance_contrast(differences, window) if window else differences
    sums = reduce(
        np.minimum,
        (window_sums(contrasted, settings.length, speed, lag) for speed in settings.speeds),
    )
    return [_match(row, settings.neighbourhood_window // 2) for row in sums]


def _normalise_patches(images: NDArray[np.float32], patch: int) -> NDArray[np.float64]:
    """Give every patch mean 0 and deviation 1, a flat one 0; (n, H, W) to (n, H W)."""
    count, height, width = images.shape
    if height % patch or width % patch:
        raise ConfigError(
            f"patches of {patch}×{patch} pixels do not tile images of {width}×{height}: give "
            "SeqSLAM a patch that divides both"
        )
    tiles = images.astype(np.float64).reshape(count, height // patch, patch, width // patch, patch)
    tiles -= tiles.mean(axis=(2, 4), keepdims=True)
    spread = tiles.std(axis=(2, 4), keepdims=True)
    tiles /= np.where(spread > 0, spread, 1)
    return tiles.reshape(count, height * width)


def _enhance_contrast(differences: NDArray[np.float32], window: int) -> NDArray[np.float64]:
    """Replace a difference by its z-score among those of the places around, made positive.

    D'(t, j) = (D(t, j) - mean) / deviation over the places j - R/2 .. j + R/2 that exist; 0 where
    these are all alike.
    """
    # Contiguous by place, for speed. In float64 the mean of equal float32 is exact: deviation 0.
    by_place = np.ascontiguousarray(differences.T, np.float64)
    enhanced = np.zeros_like(by_place)
    for place, own in enumerate(by_place):
        around = by_place[max(place - window // 2, 0) : place + window // 2 + 1]
        spread = around.std(axis=0, ddof=1)
        np.divide(own - around.mean(axis=0), spread, out=enhanced[place], where=spread > 0)
    return enhanced.T + _lowest_z_score(2 * (window // 2) + 1)


def _lowest_z_score(samples: int) -> float:
    """Return how far below 0 a z-score among so many samples can be, (n - 1) / sqrt(n).

    OpenSeqSLAM2 adds a constant that makes the lowest z-score of the whole query 0. That would need
    later frames; this bound does not, and a good match comes close to it.
    """
    return (samples - 1) / math.sqrt(samples)


def _match(sums: NDArray[np.float64], neighbourhood: int) -> Match:
    sums = np.maximum(sums, _LEAST_SUM)
    place = int(np.argmin(sums))
    best = float(sums[place])
    if best == np.inf:
        return Match(UNANSWERED, 0.0)
    before = sums[: max(place - neighbourhood, 0)]
    after = sums[place + neighbourhood + 1 :]
    second = float(min(before.min(initial=np.inf), after.min(initial=np.inf)))
    return Match(place, second / best if second < np.inf else 1.0)
