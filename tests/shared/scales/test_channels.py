from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.metrics import adjusted_rand_score

from placefield.errors import MapError
from placefield.scales.channels import make_channels
from placefield.scales.encoding import encode


def drive(frames: int = 200, dimensions: int = 30) -> NDArray[np.float32]:
    """Looks that change gradually and, every so often, at once."""
    rng = np.random.default_rng(8)
    steps = rng.normal(scale=0.3, size=(frames, dimensions))
    steps[rng.choice(frames, frames // 15, replace=False)] *= 6
    return np.cumsum(steps, axis=0).astype(np.float32)


def test_each_channel_is_its_clusters_encoded() -> None:
    channels = make_channels(drive(), channels=3, min_scale=4, seed=0, fuzzifiers=(1.1, 1.3))
    assert [channel.fuzzifier for channel in channels] == pytest.approx([1.1, 1.2, 1.3])
    for channel in channels:
        expected = encode(channel.clusters, 4)
        np.testing.assert_array_equal(channel.encoding.labels, expected.labels)
        assert channel.encoding.scales.min() >= 4


def test_channels_overlap_instead_of_repeating_each_other() -> None:
    channels = make_channels(drive(), channels=4, min_scale=4, seed=0)
    likeness = [
        adjusted_rand_score(a.clusters, b.clusters)
        for number, a in enumerate(channels)
        for b in channels[:number]
    ]
    assert max(likeness) < 0.9


def test_same_seed_same_channels() -> None:
    first, second = (make_channels(drive(), channels=2, min_scale=4, seed=7) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a.clusters, b.clusters)


def test_the_given_number_of_clusters_is_used() -> None:
    (channel,) = make_channels(drive(), channels=1, clusters=5, min_scale=4, seed=0)
    assert set(channel.clusters) == set(range(5))


def test_metres_make_the_lower_limit_one_of_distance() -> None:
    centimetres = np.arange(200) / 100
    (channel,) = make_channels(drive(), channels=1, min_scale=0.05, seed=0, travelled=centimetres)
    assert channel.encoding.scales.min() >= 5


def test_refuses_a_reference_too_short_for_segments() -> None:
    with pytest.raises(
        MapError, match=r"of 6 frames is too short.*of 4 frames or more.*--min-scale"
    ):
        make_channels(drive(6), channels=2, min_scale=4, seed=0)


@pytest.mark.parametrize(
    ("traverse", "size"), [("gardens_point/day_left", (64, 48)), ("nordland/summer", (64, 32))]
)
def test_real_routes_are_nearly_wholly_active_at_many_scales(
    data_dir: Path, traverse: str, size: tuple[int, int]
) -> None:
    paths = sorted((data_dir / traverse).iterdir())[:400]
    frames = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in paths]
    pixels = np.stack([cv2.resize(frame, size).ravel() for frame in frames if frame is not None])
    left, spread, _ = np.linalg.svd(pixels - pixels.mean(axis=0), full_matrices=False)
    descriptors = (left * spread)[:, :100].astype(np.float32)
    for channel in make_channels(descriptors, channels=4, min_scale=4, seed=0):
        assert channel.encoding.active > 0.85
        assert len(channel.encoding.scales) >= 6
