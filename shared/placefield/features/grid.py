"""Means over a grid of cells."""

import numpy as np
from numpy.typing import NDArray


def grid_means(maps: NDArray[np.float32], rows: int, columns: int) -> NDArray[np.float32]:
    """Mean of each map over the cells of a grid: (C, H, W) float32 to (C, rows, columns).

    Cell edges are rounded down to whole pixels; H and W are at least ``rows`` and ``columns``.
    """
    height, width = maps.shape[1:]
    tops, lefts = np.arange(rows) * height // rows, np.arange(columns) * width // columns
    sums = np.add.reduceat(np.add.reduceat(maps, tops, axis=1), lefts, axis=2)
    counts = np.outer(np.diff([*tops, height]), np.diff([*lefts, width]))
    return np.asarray(sums / counts, np.float32)
