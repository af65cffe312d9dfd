"""The inner loops of LMNN, over the impostors in a tile of distances."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, least_of, sum_of

Floats = NDArray[np.floating[Any]]
Labels = NDArray[np.integer[Any]]


@kernel
def push_impostors(
    products: Floats,
    first_row: int,
    first_column: int,
    points: Floats,
    squares: Floats,
    labels: Labels,
    radii: Floats,
    triplets: Floats,
    forces: Floats,
) -> None:
    """Add what the invasions among a tile of pairs of points contribute.

    A pair of points of different labels invades once for each radius above its squared distance, of
    either point. Each invasion is a triplet of the point with that radius, and adds the offset
    between the points to L P, as a force on both.

    Args:
        products: (A, B) of points ``first_row`` and following with points ``first_column`` and
            following; it is overwritten. Of equal first points only pairs above the diagonal count.
        first_row: the number of the first point of the rows.
        first_column: likewise of the columns.
        points: (K, M), P.
        squares: (K,), the squared length of each point.
        labels: (K,) int.
        radii: (k, K), see ``_radii`` of LMNN.
        triplets: (k, K), the triplets of each point; the new ones are added.
        forces: (K, M), L P; the new ones are added.
    """
    targets, dimensions = len(radii), points.shape[1]
    columns = slice(first_column, first_column + products.shape[1])
    widest = radii[:, columns].max()
    invasions = np.empty_like(products[0])
    two, one, none = invasions.dtype.type(2), invasions.dtype.type(1), invasions.dtype.type(0)
    for i in range(len(products)):
        row = first_row + i
        near = products[i]
        skipped = i + 1 if first_row == first_column else 0
        near[:skipped] = np.inf
        for j in range(skipped, len(near)):
            column = first_column + j
            distance = max(none, squares[row] + squares[column] - two * near[j])
            near[j] = np.inf if labels[column] == labels[row] else distance
        if least_of(near) >= max(widest, radii[:, row].max()):
            continue
        invasions[:] = none
        for target in range(targets):
            radius, of_columns = radii[target, row], radii[target, columns]
            counts = triplets[target, columns]
            of_row = 0
            for j in range(len(near)):
                invades_row = one if near[j] < radius else none
                invades_column = one if near[j] < of_columns[j] else none
                of_row += 1 if near[j] < radius else 0
                counts[j] += invades_column
                invasions[j] += invades_row + invades_column
            triplets[target, row] += of_row
        for j in range(len(near)):
            if invasions[j] == none:
                continue
            column = first_column + j
            for m in range(dimensions):
                force = invasions[j] * (points[row, m] - points[column, m])
                forces[row, m] += force
                forces[column, m] -= force


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
