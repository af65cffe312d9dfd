"""A frame as another traverse might have seen it: other light, focus, sensor or side of the road.

Each perturbation draws its strength from a range that is seen between two real traverses. All take
and return uint8 images, (H, W) or (H, W, 3), and leave their argument as it is.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]


def perturb(image: Image, kind: str, rng: np.random.Generator) -> Image:
    """Apply one of the perturbations `KINDS` to an image, at a strength drawn from `rng`.

    Raises KeyError where there is no such kind.
    """
    return _PERTURBATIONS[kind](image, rng)


def _brightness(image: Image, rng: np.random.Generator) -> Image:
    """Darken or brighten by a gamma of 1.35 to 2.2 or its inverse; black and white stay."""
    gamma = np.exp(_either_way(0.3, 0.8, rng))
    curve = 255 * np.linspace(0, 1, 256) ** gamma
    return np.asarray(cv2.LUT(image, np.rint(curve).astype(np.uint8)), np.uint8)


def _blur(image: Image, rng: np.random.Generator) -> Image:
    """Blur by a Gaussian of a deviation of 0.5 to 1.5 % of the width."""
    deviation = image.shape[1] * rng.uniform(0.005, 0.015)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), deviation), np.uint8)


def _noise(image: Image, rng: np.random.Generator) -> Image:
    """Add Gaussian noise of a deviation of 10 to 25 grey levels to every value."""
    noise = rng.standard_normal(image.shape, np.float32) * np.float32(rng.uniform(10, 25))
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def _shift(image: Image, rng: np.random.Generator) -> Image:
    """Move the image sideways by 2 to 6 % of its width; the edge fills what comes free."""
    height, width = image.shape[:2]
    move = np.array([[1, 0, width * _either_way(0.02, 0.06, rng)], [0, 1, 0]])
    shifted = cv2.warpAffine(image, move, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(shifted, np.uint8)


def _either_way(low: float, high: float, rng: np.random.Generator) -> float:
    """Draw from [low, high] or, as often, from [-high, -low]."""
    return float(rng.choice((-1, 1)) * rng.uniform(low, high))


_PERTURBATIONS: dict[str, Callable[[Image, np.random.Generator], Image]] = {
    "brightness": _brightness,
    "blur": _blur,
    "noise": _noise,
    "shift": _shift,
}

KINDS = tuple(_PERTURBATIONS)
