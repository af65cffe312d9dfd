"""The inner loops of LMNN, over the impostors in a tile of distances."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, sum_of

Floats = NDArray[np.floating[Any]]
Labels = NDArray[np.integer[Any]]


@kernel
def mark_invasions(
    distances: Floats,
    row_labels: Labels,
    column_labels: Labels,
    row_radii: Floats,
    column_radii: Floats,
    row_triplets: Floats,
    column_triplets: Floats,
    diagonal: bool,
) -> bool:
    """Replace the distances (A, B) of two sets of points by the number of invasions of each pair.

    A pair of points of different labels invades once for each radius above its distance, of either
    point: (k, A) and (k, B). Each invasion is a triplet of the point with that radius, and is added
    to the triplets (k, A) or (k, B). On the diagonal, where rows and columns are the same points,
    only the pairs above it count. Returns whether any pair invades.
    """
    weights = np.empty_like(distances[0])
    one, none = weights.dtype.type(1), weights.dtype.type(0)
    found = False
    for row in range(len(distances)):
        near = distances[row]
        if diagonal:
            near[: row + 1] = np.inf
        for column in range(len(near)):
            if column_labels[column] == row_labels[row]:
                near[column] = np.inf
        weights[:] = 0
        for target in range(len(row_radii)):
            radius, radii = row_radii[target, row], column_radii[target]
            of_columns = column_triplets[target]
            of_row = 0
            for column in range(len(near)):
                invades_row = one if near[column] < radius else none
                invades_column = one if near[column] < radii[column] else none
                of_row += 1 if near[column] < radius else 0
                of_columns[column] += invades_column
                weights[column] += invades_row + invades_column
            row_triplets[target, row] += of_row
        near[:] = weights
        found |= weights.any()
    return found


@kernel
def sum_hinges(
    distances: Floats, row_labels: Labels, column_labels: Labels, row_radii: Floats
) -> float:
    """Sum the depths of columns of other labels inside the radii, (k, A), of the rows.

    distances is (A, B).
    """
    total = 0.0
    depths = np.empty_like(distances[0])
    for row in range(len(distances)):
        near, label = distances[row], row_labels[row]
        for target in range(len(row_radii)):
            radius = row_radii[target, row]
            for column in range(len(near)):
                inside = near[column] < radius and column_labels[column] != label
                depths[column] = radius - near[column] if inside else 0
            total += sum_of(depths)
    return total
