import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.features.local_descriptors import SPAN, LocalDescriptor, LocalDescriptors

Array = NDArray[np.float32]


def random_raws(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).normal(10, 1, (count, 30)).astype(np.float32)


def described(raws: list[Array | None]) -> list[list[LocalDescriptor]]:
    stream = LocalDescriptors()
    return [stream.update(raw) for raw in raws]


def test_the_first_frames_come_together_once_the_view_has_changed_enough() -> None:
    lists = described([*random_raws(40)])
    released = next(number for number, each in enumerate(lists) if each)
    assert [frame.frame for frame in lists[released]] == [*range(released + 1)]
    assert lists[released][-1].travelled >= SPAN > lists[released][-2].travelled
    assert [[frame.frame for frame in each] for each in lists[released + 1 :]] == [
        [number] for number in range(released + 1, 40)
    ]


def test_descriptors_have_length_1_and_no_mean() -> None:
    frames = [frame for each in described([*random_raws(300)]) for frame in each]
    vectors = np.array([frame.vector for frame in frames])
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, rtol=1e-5)
    assert np.abs(vectors.mean(axis=0)).max() < 0.05


@given(st.floats(0.1, 10), st.integers(0, 5))
def test_contrast_does_not_matter(gain: float, seed: int) -> None:
    raws = random_raws(40, seed)
    one, other = described([*raws])[-1], described([*(raws * np.float32(gain))])[-1]
    np.testing.assert_allclose(one[0].vector, other[0].vector, atol=1e-3)


def test_a_vehicle_that_stands_keeps_its_descriptor_and_travels_no_further() -> None:
    raws = random_raws(40)
    rng = np.random.default_rng(1)
    noise = rng.normal(scale=0.01, size=(500, 30)).astype(np.float32)
    lists = described([*raws, *(raws[-1] + noise)])
    for (still,) in lists[40:]:
        np.testing.assert_array_equal(still.vector, lists[39][0].vector)
        assert still.travelled == lists[39][0].travelled


@pytest.mark.parametrize("unobserved", [None, np.full(30, 7, np.float32)])
def test_an_unobserved_or_blank_frame_counts_and_has_no_descriptor(
    unobserved: Array | None,
) -> None:
    lists = described([*random_raws(40), unobserved, random_raws(1, seed=3)[0]])
    assert lists[40] == []
    assert lists[41][0].frame == 41


@pytest.mark.parametrize("wrong", [np.ones(29, np.float32), np.full(30, np.nan, np.float32)])
def test_a_wrong_feature_is_refused_and_changes_nothing(wrong: Array) -> None:
    raws = random_raws(50)
    stream = LocalDescriptors()
    for raw in raws[:49]:
        stream.update(raw)
    with pytest.raises(FrameError, match="feature"):
        stream.update(wrong)
    (after,) = stream.update(raws[49])
    np.testing.assert_array_equal(after.vector, described([*raws])[-1][0].vector)
    assert after.frame == 49
