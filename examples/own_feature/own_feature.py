"""Bring a feature of your own, by the entry point in the ``pyproject.toml`` beside this.

    pip install examples/own_feature
    placefield build demo/day -o edges.pfmap --feature edges
    python examples/own_feature/own_feature.py demo/day demo/dusk       # or in a program

Everything else stays as it is: scales, metrics, matching, services.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield import Recognizer, build_map
from placefield.loading import load_config


def edges(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
    """Describe B images, each (H, W) or (H, W, 3) BGR, by their edges: (B, 192)."""
    return np.stack([edges_of(pixels) for pixels in images])


def edges_of(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return the edges of an image in four directions, (192,)."""
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 2)
    across, down = cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)
    directions = [np.maximum(edge, 0) for edge in (across, -across, down, -down)]
    small = [cv2.resize(edge, (8, 6), interpolation=cv2.INTER_AREA) for edge in directions]
    return np.stack(small).ravel().astype(np.float32)


def main(reference: str, query: str) -> None:
    """Print the place of each frame of the second folder among those of the first."""
    config = load_config(None, {"features": {"kind": "edges"}})
    recognizer = Recognizer(build_map(sorted(Path(reference).glob("*.jpg")), config=config))
    for file in sorted(Path(query).glob("*.jpg")):
        print(file.name, recognizer.update(file).place)


if __name__ == "__main__":
    main(*sys.argv[1:])
