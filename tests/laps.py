"""A made-up drive of two laps."""

import cv2
import numpy as np
from numpy.typing import NDArray

PLACES, FRAMES = 70, 140


def images_of_laps() -> list[NDArray[np.uint8]]:
    """Return the images of two laps of a circuit, whose views change gradually."""
    rng = np.random.default_rng(0)
    views, view = [], rng.normal(size=(12, 16))
    for _ in range(PLACES):
        view = 0.7 * view + rng.normal(size=(12, 16))
        views.append(view)
    images = []
    for number in range(FRAMES):
        seen = views[number % PLACES] + rng.normal(scale=0.2, size=(12, 16))
        small = np.clip(128 + 30 * seen, 0, 255).astype(np.uint8)
        images.append(np.asarray(cv2.resize(small, (64, 48)), np.uint8))
    return images
