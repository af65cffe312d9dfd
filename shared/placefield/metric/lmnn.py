"""Large-margin nearest-neighbour metric learning (LMNN; Weinberger and Saul, JMLR 2009).

Every point i is pulled towards its target neighbours j, the nearest points of its own label. The
points l of other labels, its impostors, are pushed a margin of 1 beyond the targets:

    E(v) = (1 − push) Σ_ij d(i, j) + push Σ_ijl max(0, 1 + d(i, j) − d(i, l)),
    d(i, j) = ‖v (x_i − x_j)‖².

Divided by 1 − push this is Eq. 8 of the AMS paper with λ = push / (1 − push), so its λ ∈ [0, 1] is
push ∈ [0, ½]. metric-learn's `LMNN` minimises the same E with `regularization` = 1 − push.

An active triplet (i, j, l) adds 1 + d(i, j) − d(i, l) to the second sum; any other triplet adds
nothing. So E is a weighted sum of squared distances between pairs of points plus push for each
active triplet: E = push · triplets + tr(Pᵀ L P), where P = X vᵀ and L is the graph Laplacian of the
pair weights. Its gradient is 2 (L P)ᵀ X. So a few matrix products replace a visit to every triplet.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

from placefield.blocks import blocks
from placefield.metric.impostors import push_impostors, sum_hinges
from placefield.metric.squared_distances import Floats, squared_distances

Labels = NDArray[np.integer[Any]]

_BLOCK = 256  # rows and columns of the distance matrix held at once
_FIRST_MOVE = 0.01  # length of the first move, relative to the projection's norm
GROWTH = 1.5
"""Factor on the step size after each step."""


@dataclass(frozen=True)
class LmnnFit:
    """The result of `fit_lmnn`: the last projection, and the objective after each step.

    Attributes:
        projection: (N, N) float32, the paper's v.
        objective: (steps done + 1,) float64, E at the start and after each step, each less than the
            one before.
    """

    projection: NDArray[np.float32]
    objective: NDArray[np.float64]


def fit_lmnn(
    descriptors: NDArray[np.float32],
    labels: Labels,
    *,
    neighbours: int,
    push: float,
    steps: int,
    start: NDArray[np.float32] | None = None,
    on_step: Callable[[int, NDArray[np.float32]], bool] | None = None,
) -> LmnnFit:
    """Minimise E by gradient descent, each step lowering it.

    descriptors is (K, N) float32, centred, because a large common offset costs digits; labels is
    (K,), start the (N, N) projection to begin with (the identity). After each step `on_step` is
    called with its number, from 1, and the projection, and returns True to stop. There are fewer
    than `steps` steps if no step lowers E any more.

    Gradient descent is preferred to L-BFGS, which lowers E faster: its first steps are so long that
    early stopping has little choice between the identity and an over-fitted metric.
    """
    targets = target_neighbours(descriptors, labels, neighbours)
    projection = np.eye(descriptors.shape[1], dtype=np.float32) if start is None else start
    value, gradient = objective(projection, descriptors, labels, targets, push)
    values = [value]
    size = first_size(projection, gradient)
    while len(values) <= steps and not is_negligible(size * gradient, projection):
        candidate = projection - size * gradient
        value, candidate_gradient = objective(candidate, descriptors, labels, targets, push)
        if value >= values[-1]:
            size /= 2
            continue
        projection, gradient = candidate, candidate_gradient
        values.append(value)
        size *= GROWTH
        if on_step is not None and on_step(len(values) - 1, projection):
            break
    return LmnnFit(projection, np.array(values))


def target_neighbours(
    descriptors: Floats,
    labels: Labels,
    neighbours: int,
    eligible: NDArray[np.bool_] | None = None,
) -> NDArray[np.intp]:
    """Find each point's target neighbours: the nearest other points of its label, nearest first.

    descriptors is (K, N), labels is (K,), eligible the (K,) points that may be targets (all).
    Returns (K, neighbours) indices; missing neighbours are -1, in the last columns. Only a block of
    the distances is held at once.
    """
    if eligible is None:
        eligible = np.ones(len(labels), dtype=np.bool_)
    targets = np.full((len(labels), neighbours), -1, dtype=np.intp)
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        candidates = members[eligible[members]]
        if not len(candidates):
            continue
        for rows in blocks(len(members), _BLOCK):
            block = members[rows]
            distances = squared_distances(descriptors[block], descriptors[candidates])
            distances[block[:, None] == candidates] = np.inf
            targets[block] = _nearest(distances, candidates, neighbours)
    return targets


def target_distances(points: Floats, targets: NDArray[np.intp]) -> Floats:
    """Compute d(i, j) of points (K, N) and their targets (K, k): (k, K), 0 for no target."""
    distances = np.zeros(targets.T.shape, points.dtype)
    for rows in blocks(len(points), _BLOCK):
        for found, column in zip(distances[:, rows], targets[rows].T, strict=True):
            offsets = points[rows] - points[column]
            found[:] = np.where(column >= 0, np.einsum("kn,kn->k", offsets, offsets), 0)
    return distances


def objective(
    projection: Floats, descriptors: Floats, labels: Labels, targets: NDArray[np.intp], push: float
) -> tuple[float, Floats]:
    """Compute E and its gradient with respect to the projection.

    projection (M, N) and descriptors (K, N, centred) are of one float dtype, which the arithmetic
    keeps; labels is (K,), targets (K, k) as of `target_neighbours`, push is in [0, 1]. Returns E
    and the (M, N) gradient. Only a tile of the (K, K) distances is held at once.
    """
    projected = descriptors @ projection.T
    triplets, forces = _push(projected, labels, _radii(projected, targets))
    forces *= -push
    pull = _laplacian(targets, (1 - push) + push * triplets.T)
    for rows in blocks(len(projected), _BLOCK):
        forces[rows] += pull[rows] @ projected
    trace = np.einsum("km,km->", projected, forces, dtype=np.float64)
    value = push * triplets.sum(dtype=np.float64) + trace
    return float(value), 2 * (forces.T @ descriptors)


def loss(
    projection: Floats, descriptors: Floats, labels: Labels, targets: NDArray[np.intp], push: float
) -> float:
    """Compute E alone, in time proportional to the number of points that have targets.

    The arguments are those of `objective`.
    """
    projected = descriptors @ projection.T
    radii = _radii(projected, targets)
    anchors = np.flatnonzero((targets >= 0).any(axis=1))
    hinges = 0.0
    for rows in blocks(len(anchors), _BLOCK):
        block = anchors[rows]
        for columns in blocks(len(projected), _BLOCK):
            distances = squared_distances(projected[block], projected[columns])
            hinges += sum_hinges(distances, labels[block], labels[columns], radii[:, block])
    pulls = (radii - 1).sum(where=targets.T >= 0, dtype=np.float64)
    return float((1 - push) * pulls + push * hinges)


def first_size(projection: Floats, gradient: Floats) -> float:
    """Return the size of the first step along the gradient; 0 where that vanishes."""
    steepness = float(np.linalg.norm(gradient))
    return _FIRST_MOVE * float(np.linalg.norm(projection)) / steepness if steepness else 0.0


def is_negligible(move: Floats, projection: Floats) -> bool:
    """Return whether a move changes a projection no more than rounding does."""
    return bool(np.linalg.norm(move) <= np.finfo(np.float32).eps * np.linalg.norm(projection))


def _nearest(distances: Floats, candidates: NDArray[np.intp], neighbours: int) -> NDArray[np.intp]:
    """Return the nearest candidates of each row, (A, neighbours), -1 if only infinity is left."""
    rows = np.arange(len(distances))
    nearest = np.full((len(distances), neighbours), -1, dtype=np.intp)
    for column in range(neighbours):
        found = distances.argmin(axis=1)
        nearest[:, column] = np.where(distances[rows, found] < np.inf, candidates[found], -1)
        distances[rows, found] = np.inf
    return nearest


def _push(projected: Floats, labels: Labels, radii: Floats) -> tuple[Floats, Floats]:
    """Count each point's active triplets, (k, K), and sum L P over their pairs, (K, M).

    Distances are symmetric: every pair is visited once, and counts for both of its points.
    """
    triplets = np.zeros_like(radii)
    forces = np.zeros_like(projected)
    squares = np.einsum("km,km->k", projected, projected)
    for rows in blocks(len(projected), _BLOCK):
        for columns in blocks(len(projected), _BLOCK):
            if columns.start < rows.start:
                continue
            products = projected[rows] @ projected[columns].T
            push_impostors(
                products,
                rows.start,
                columns.start,
                projected,
                squares,
                labels,
                radii,
                triplets,
                forces,
            )
    return triplets, forces


def _radii(projected: Floats, targets: NDArray[np.intp]) -> Floats:
    """Return the least distance of impostors for each target: 1 + d(i, j), or 0 for no target.

    (k, K). No distance is below 0, so a missing target has no impostors.
    """
    return np.where(targets.T >= 0, 1 + target_distances(projected, targets), 0)


def _laplacian(targets: NDArray[np.intp], weights: Floats) -> csr_array:
    """Return the (K, K) graph Laplacian of pairs of points and targets, both (K, k), by weight."""
    points, columns = np.nonzero(targets >= 0)
    ends = (points, targets[points, columns])
    pairs = csr_array((weights[points, columns], ends), shape=(len(targets), len(targets)))
    pairs = pairs + pairs.T
    return csr_array(diags_array(pairs.sum(axis=1)) - pairs)
