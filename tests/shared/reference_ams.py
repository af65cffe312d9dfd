"""AMS (Fan et al. 2017) in float64, from raw features to matches: the reference for tests.

It follows the equations of the paper, and placefield's documentation where the paper is open.
No computation is placefield's. Frames and places are counted from 0.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Labels = NDArray[np.integer]
Mask = NDArray[np.bool_]
Option = tuple[float, int]
"""A score F(Y), and the place Y."""

RADIUS, APART = 0.9, 4
"""Of a cluster, in root-mean-square distances of frames that are so far apart."""

LAMBDAS = (0.25, 0.5, 0.75, 1.0)
NEIGHBOURS = 3  # k
STEPS = 30
PATIENCE = 5


@dataclass(frozen=True)
class LiteralChannel:
    """One channel: its labels (K,), its scales ascending, and v (N, N) of Eq. 6."""

    labels: Labels
    scales: list[int]
    v: Array


@dataclass(frozen=True)
class ReferenceMap:
    """What the reference traverse has taught.

    Attributes:
        mean: (D,), of the raw features.
        axes: (N, D), principal ones.
        places: (K, N).
        smallest: s_min of all channels.
        weight: the paper's λ.
        channels: L of them.
    """

    mean: Array
    axes: Array
    places: Array
    smallest: int
    weight: float
    channels: list[LiteralChannel]


def build(
    raws: Array, dimensions: int, fuzzifiers: Iterable[float], smallest: int, seed: int
) -> ReferenceMap:
    """Learn from the raw features (K, D) of a reference traverse."""
    mean = raws.mean(axis=0)
    axes = np.linalg.svd(raws - mean, full_matrices=False)[2][: min(dimensions, len(raws) - 1)]
    places = (raws - mean) @ axes.T
    clusters = count_clusters(places)
    encoded = [
        encode(fuzzy_clusters(places, clusters, fuzzifier, seed), smallest)
        for fuzzifier in fuzzifiers
    ]
    weight = cross_validated(places, encoded[0][0], seed)
    trained = ~held_back(len(places), seed)
    channels = [
        LiteralChannel(labels, scales, learn(places, labels, trained, weight))
        for labels, scales in encoded
    ]
    return ReferenceMap(mean, axes, places, smallest, weight, channels)


# Clusters: the paper's reference [33], and Eqs. 1 to 3.


def count_clusters(x: Array) -> int:
    """Count the centres that Chiu's subtractive clustering finds among the descriptors alone."""
    points = x.tolist()
    steps = [math.dist(a, b) ** 2 for a, b in zip(points, points[APART:], strict=False)]
    ra = RADIUS * math.sqrt(sum(steps) / len(steps))
    rb = 1.5 * ra
    potentials = [sum(math.exp(-4 * math.dist(a, b) ** 2 / ra**2) for b in points) for a in points]
    first = max(potentials)
    centres: list[int] = []
    while True:
        best = potentials.index(max(potentials))
        height = potentials[best]
        if height < 0.15 * first:
            return len(centres)
        nearest = min((math.dist(points[best], points[c]) for c in centres), default=math.inf)
        if height > 0.5 * first or nearest / ra + height / first >= 1:
            centres.append(best)
            for i, point in enumerate(points):
                potentials[i] -= height * math.exp(-4 * math.dist(point, points[best]) ** 2 / rb**2)
        potentials[best] = 0


def fuzzy_clusters(x: Array, clusters: int, m: float, seed: int) -> Labels:
    """Minimise J of Eqs. 2 and 3 by turns, and return each frame's cluster of highest membership.

    The first centres are the means of stretches of the route, which the seed alone draws.
    """
    rng = np.random.default_rng(seed)
    ends = np.sort(rng.choice(np.arange(1, len(x)), clusters - 1, replace=False))
    c = np.array([stretch.mean(axis=0) for stretch in np.split(x, ends)])
    for _ in range(100):
        away = np.array([[math.dist(x_i, c_k) for c_k in c] for x_i in x])
        # A frame may be a centre. In units of its least distance, the powers stay finite.
        nearness = (away.min(axis=1, keepdims=True) + 1e-12) / (away + 1e-12)
        mu = np.array([row / row.sum() for row in nearness ** (2 / (m - 1))])
        moved = np.array([weights @ x / weights.sum() for weights in (mu**m).T])
        furthest = max(math.dist(before, after) for before, after in zip(c, moved, strict=True))
        if furthest <= 1e-3 * away.min(axis=1).mean():
            break
        c = moved
    return mu.argmax(axis=1)


# Scales: rules 1 and 2, and Eq. 4.


def encode(clusters: Labels, smallest: int) -> tuple[Labels, list[int]]:
    """Return the labels of the runs of one cluster, and their distinct lengths."""
    labels = np.zeros(len(clusters), np.int64)
    lengths: list[int] = []
    first = 0
    for frame in range(1, len(clusters) + 1):
        if frame < len(clusters) and clusters[frame] == clusters[first]:
            continue
        if frame - first >= smallest:  # rule 1: else it is inactive
            lengths.append(frame - first)
            labels[first:frame] = len(lengths)  # rule 2
        first = frame
    return labels, sorted(set(lengths))


# The metric: Eq. 8.


def held_back(count: int, seed: int) -> Mask:
    """Choose 20 % of the frames, in blocks of 3."""
    blocks = math.ceil(count / 3)
    chosen = np.random.default_rng(seed).choice(blocks, round(0.2 * blocks), replace=False)
    return np.array([frame // 3 in chosen for frame in range(count)])


def cross_validated(x: Array, labels: Labels, seed: int) -> float:
    """Return the λ of the fewest errors, and of several the smallest.

    Blocks of 3 frames are partitioned into 5 parts. Each part is held back once. An error is one of
    its frames whose nearest frame in the other parts has another label.
    """
    part_of_block = np.random.default_rng(seed).permutation(math.ceil(len(x) / 3))
    part_of = np.array([part_of_block[frame // 3] % 5 for frame in range(len(x))])
    errors = dict.fromkeys(LAMBDAS, 0)
    for weight in LAMBDAS:
        for part in range(5):
            trained = part_of != part
            v = learn(x, labels, trained, weight)
            for asked in np.flatnonzero(~trained):
                away = [distance(v, x[asked], other) for other in x[trained]]
                errors[weight] += labels[trained][np.argmin(away)] != labels[asked]
    return min(LAMBDAS, key=lambda weight: errors[weight])


def learn(
    x: Array, labels: Labels, trained: Mask, weight: float, neighbours: int = NEIGHBOURS
) -> Array:
    """Learn v by gradient descent on Eq. 8, stopped early by the frames that are not trained on.

    The margin of 1 is one mean squared distance of trained frames to their target neighbours. At
    the end v is scaled so that the mean squared distance of all frames is what it was.
    """
    every = np.ones(len(x), np.bool_)
    targets = target_neighbours(x, labels, trained, neighbours)
    squares = [((x[i] - x[j]) ** 2).sum() for i in np.flatnonzero(trained) for j in targets[i]]
    v = best = np.eye(x.shape[1]) / math.sqrt(float(np.mean(squares)))
    E, gradient = eq_8(v, x, labels, targets, trained, trained, weight)
    losses = [eq_8(v, x, labels, targets, ~trained, every, weight)[0]]
    size = 0.01 * float(np.linalg.norm(v) / np.linalg.norm(gradient))
    while len(losses) <= STEPS and np.linalg.norm(size * gradient) > 1e-7 * np.linalg.norm(v):
        to = v - size * gradient
        lower, its_gradient = eq_8(to, x, labels, targets, trained, trained, weight)
        if lower >= E:
            size /= 2
            continue
        v, E, gradient = to, lower, its_gradient
        size *= 1.5
        losses.append(eq_8(v, x, labels, targets, ~trained, every, weight)[0])
        if losses[-1] < min(losses[:-1]):
            best = v
        if len(losses) - 1 - losses.index(min(losses)) >= PATIENCE:
            break
    centred = x - x.mean(axis=0)
    return best * float(np.linalg.norm(centred) / np.linalg.norm(centred @ best.T))


def target_neighbours(x: Array, labels: Labels, trained: Mask, neighbours: int) -> list[list[int]]:
    """Return j → i: of each frame the nearest trained ones of its label."""
    targets = []
    for i in range(len(x)):
        own = [int(j) for j in np.flatnonzero(trained & (labels == labels[i])) if j != i]
        own.sort(key=lambda j: math.dist(x[i], x[j]))
        targets.append(own[:neighbours])
    return targets


def eq_8(
    v: Array,
    x: Array,
    labels: Labels,
    targets: list[list[int]],
    asked: Mask,
    impostors: Mask,
    weight: float,
) -> tuple[float, Array]:
    """Return the objective of some frames i, whose l are among the impostors, and its gradient.

    The sum over j → i of d(i, j) + λ Σ_l (1 - y_il) ε_ijl, where ε_ijl = max(0, 1 + d(i, j) -
    d(i, l)) is the least that the constraints 1 and 2 allow. The third is kept by M = vᵀv.
    """
    objective, outer = 0.0, np.zeros_like(v)
    for i in np.flatnonzero(asked):
        near = x[targets[i]] - x[i]
        far = x[impostors & (labels != labels[i])] - x[i]
        d_ij, d_il = (((offsets @ v.T) ** 2).sum(axis=1) for offsets in (near, far))
        epsilon = np.maximum(0, 1 + d_ij[:, None] - d_il)
        objective += d_ij.sum() + weight * epsilon.sum()
        # The gradient of d(i, j) is 2 v (x_i - x_j)(x_i - x_j)ᵀ.
        invades = epsilon > 0
        outer += near.T @ ((1 + weight * invades.sum(axis=1))[:, None] * near)
        outer -= weight * far.T @ (invades.sum(axis=0)[:, None] * far)
    return objective, 2 * v @ outer


def distance(v: Array, x_i: Array, x_j: Array) -> float:
    """Eqs. 5 to 7."""
    offset = v @ (x_i - x_j)
    return float(offset @ offset)


# Matching: Eqs. 11 to 16.


def match(reference: ReferenceMap, raws: Array, blur: float = 0) -> list[list[Option]]:
    """Return what may be the match of each frame of a query (Q, D): F(Y) and Y.

    That is one, unless scores are so near each other that a blur of so much in their square roots
    decides. It is none where no channel has an answer.
    """
    descriptors = (raws - reference.mean) @ reference.axes.T
    D_M = [
        np.array([[distance(c.v, x, r) for r in reference.places] for x in descriptors])
        for c in reference.channels
    ]
    answers = []
    for frame in range(len(descriptors)):
        hypotheses = [
            hypothesis(D[frame:], reference.smallest, coarse, blur)
            for D, channel in zip(D_M, reference.channels, strict=True)
            for coarse in coarse_scales(channel.scales, reference.smallest)
            if coarse <= min(D[frame:].shape)
        ]
        answers.append(lowest_hypotheses(hypotheses, blur))
    return answers


def coarse_scales(scales: list[int], smallest: int) -> list[int]:
    """Return the larger scales of a channel; of one that has none, the smallest."""
    return [scale for scale in scales if scale > smallest] or [smallest]


def hypothesis(D: Array, smallest: int, coarse: int, blur: float) -> list[Option]:
    """Eqs. 11 to 14 for the first row of D (frames, places): F(Y) and Y, or what may be it."""
    found: dict[int, float] = {}
    fields = window_sums(D, coarse, range(D.shape[1] - coarse + 1))
    for H in lowest(fields, blur):
        F = window_sums(D, smallest, range(H, H + coarse - smallest + 1))
        found |= {Y: F[Y] for Y in lowest(F, blur)}
    return [(F_Y, Y) for Y, F_Y in found.items()]


def window_sums(D: Array, scale: int, starts: Iterable[int]) -> dict[int, float]:
    """Eqs. 11 and 13: F of the windows of the first frames of D that begin at some places."""
    return {q: sum(float(D[j - q, j]) for j in range(q, q + scale)) for q in starts}


def lowest(F: dict[int, float], blur: float) -> list[int]:
    """Eqs. 12 and 14: the places of the lowest score, or of nearly that."""
    least = math.sqrt(min(F.values()))
    return [place for place, score in F.items() if math.sqrt(score) <= least + 2 * blur]


def lowest_hypotheses(hypotheses: list[list[Option]], blur: float) -> list[Option]:
    """Eqs. 15 and 16: of all scales of all channels, the hypothesis of lowest score."""
    if not hypotheses:
        return []
    # What may be the match is below the others, whatever they are.
    least = math.sqrt(min(max(F for F, _ in options) for options in hypotheses))
    return [
        (F, Y) for options in hypotheses for F, Y in options if math.sqrt(F) <= least + 2 * blur
    ]
