from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.baselines.fabmap import Vocabulary, fabmap, learn_tree, learn_words
from placefield.errors import MapError
from placefield.evaluation.truth import Truth


def blotches(seed: int, height: int, width: int) -> NDArray[np.uint8]:
    coarse = np.random.default_rng(seed).random((height // 6, width // 6)).astype(np.float32)
    image = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.clip(255 * image, 0, 255), np.uint8)


@pytest.fixture(scope="module")
def vocabulary() -> Vocabulary:
    return learn_words((blotches(seed, 120, 160) for seed in range(6)), 50, seed=0)


def test_the_same_frames_and_seed_give_the_same_words(vocabulary: Vocabulary) -> None:
    again = learn_words([blotches(seed, 120, 160) for seed in range(6)], 50, seed=0)
    np.testing.assert_array_equal(again.centres, vocabulary.centres)
    other = learn_words([blotches(seed, 120, 160) for seed in range(6)], 50, seed=1)
    assert not np.array_equal(other.centres, vocabulary.centres)


def test_a_word_is_shown_where_a_keypoint_is_nearest_to_it(vocabulary: Vocabulary) -> None:
    image = blotches(9, 240, 320)
    _, descriptors = cv2.SIFT.create().detectAndCompute(image, None)
    distances = np.linalg.norm(descriptors[:, None] - vocabulary.centres[None], axis=2)
    expected = np.isin(np.arange(len(vocabulary.centres)), distances.argmin(axis=1))
    np.testing.assert_array_equal(vocabulary.observe(image), expected)


def test_a_small_frame_shows_words(vocabulary: Vocabulary) -> None:
    assert vocabulary.observe(blotches(2, 32, 64)).sum() > 5


def test_a_uniform_frame_shows_no_word(vocabulary: Vocabulary) -> None:
    assert not vocabulary.observe(np.full((32, 64), 90, np.uint8)).any()


def test_there_are_fewer_words_where_frames_give_fewer_descriptors() -> None:
    few = learn_words([blotches(1, 32, 64)] * 3, 5000, seed=0)
    assert 0 < len(few.centres) < 5000


@pytest.mark.parametrize("frames", [0, 3])
def test_frames_without_keypoints_are_refused(frames: int) -> None:
    with pytest.raises(MapError, match="no keypoint"):
        learn_words([np.zeros((48, 64), np.uint8)] * frames, 10, seed=0)


def test_knows_real_frames_again_far_above_chance(data_dir: Path) -> None:
    def frames(traverse: str) -> list[NDArray[np.uint8]]:
        files = sorted((data_dir / "gardens_point" / traverse).iterdir())[:60]
        return [np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.uint8) for file in files]

    left, right = frames("day_left"), frames("day_right")
    vocabulary = learn_words(left, 600, seed=0)
    reference = np.stack([vocabulary.observe(image) for image in left])
    query = np.stack([vocabulary.observe(image) for image in right])
    matches = fabmap(reference, query, learn_tree(reference))
    places = np.array([match.place for match in matches])
    recall = Truth.within(60, 60, tolerance=3).correct(places).mean()
    assert recall > 0.4  # chance is 7 places in 60: 0.11
