import math

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.scales import subtractive
from placefield.scales.placed import Placed, with_route_position
from placefield.scales.subtractive import PLACED, UNPLACED, Radius, estimate_clusters


def reference_estimate(vectors: NDArray[np.float32], radius: float, apart: int) -> int:
    """Count the centres as Chiu's paper words it, in naive loops."""
    points = [[float(value) for value in vector] for vector in vectors]
    steps = [math.dist(a, b) ** 2 for a, b in zip(points, points[apart:], strict=False)]
    ra = radius * math.sqrt(sum(steps) / len(steps))
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


def unplaced(vectors: NDArray[np.float32]) -> Placed:
    return with_route_position(vectors, 0)


def walk(seed: int, frames: int, dimensions: int) -> NDArray[np.float32]:
    steps = np.random.default_rng(seed).normal(size=(frames, dimensions))
    return np.cumsum(steps, axis=0).astype(np.float32)


def blobs(count: int, size: int, dimensions: int) -> NDArray[np.float32]:
    """Frames of one blob after the other, blobs ten standard deviations apart."""
    rng = np.random.default_rng(3)
    centres = 10 * np.sqrt(dimensions) * np.eye(max(count, dimensions))[:count, :dimensions]
    noise = rng.normal(size=(count * size, dimensions))
    return (np.repeat(centres, size, axis=0) + noise).astype(np.float32)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("radius", [0.4, 0.8, 1.25])
@pytest.mark.parametrize("apart", [4, 8])
def test_counts_as_naive_loops_do(
    seed: int, radius: float, apart: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subtractive, "_BLOCK", 17)
    vectors = walk(seed, 80, 3)
    assert estimate_clusters(unplaced(vectors), Radius(radius, apart)) == reference_estimate(
        vectors, radius, apart
    )


@pytest.mark.parametrize("count", [1, 2, 5])
def test_finds_as_many_clusters_as_there_are_blobs(count: int) -> None:
    assert estimate_clusters(unplaced(blobs(count, 60, 5)), PLACED) == count


def changing_at_once(frames: int) -> NDArray[np.float32]:
    rng = np.random.default_rng(0)
    views = np.repeat(rng.normal(size=(frames // 10, 100)), 10, axis=0)
    return (views + rng.normal(size=(frames, 100))).astype(np.float32)


@pytest.mark.parametrize("frames", [200, 1200])
@pytest.mark.parametrize("gradual", [False, True])
def test_gives_segments_of_natural_lengths_in_high_dimension(frames: int, gradual: bool) -> None:
    vectors = walk(0, frames, 100) if gradual else changing_at_once(frames)
    clusters = estimate_clusters(with_route_position(vectors, 1.0), PLACED)
    assert 8 < frames / clusters < 40


@pytest.mark.parametrize("gradual", [False, True])
def test_descriptors_alone_want_a_narrower_circle(gradual: bool) -> None:
    vectors = walk(0, 200, 100) if gradual else changing_at_once(200)
    assert 2 < 200 / estimate_clusters(unplaced(vectors), UNPLACED) < 60
    assert estimate_clusters(unplaced(changing_at_once(200)), PLACED) < 4


def test_standing_still_for_most_of_the_route_adds_few_clusters() -> None:
    rng = np.random.default_rng(1)
    moving = walk(2, 200, 20)
    stationary = moving[99] + rng.normal(scale=1e-3, size=(300, 20))
    with_stop = np.vstack([moving[:100], stationary, moving[100:]]).astype(np.float32)
    without = estimate_clusters(with_route_position(moving, 1.0), PLACED)
    assert estimate_clusters(with_route_position(with_stop, 1.0), PLACED) < without + 300 / 10


@pytest.mark.parametrize("frames", [1, 2, 50])
def test_equal_frames_are_one_cluster(frames: int) -> None:
    assert estimate_clusters(unplaced(np.ones((frames, 4), np.float32)), PLACED) == 1


@pytest.mark.parametrize("stationary", [False, True])
def test_of_a_long_route_the_count_is_that_of_naive_loops(
    stationary: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subtractive, "_BLOCK", 17)
    vectors = walk(4, 400, 3)
    if stationary:
        vectors[100:220] = vectors[100]
    frames, shares = with_route_position(vectors, 100.0), [0.0]
    exact = frames.exact().astype(np.float32)
    assert estimate_clusters(frames, PLACED, shares.append) == reference_estimate(exact, 1.25, 8)
    assert shares == sorted(shares)
    assert shares[-1] <= 1
