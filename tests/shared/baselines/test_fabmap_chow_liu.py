from collections.abc import Iterator
from itertools import combinations, product
from math import log

import numpy as np
import pytest
from numpy.typing import NDArray
from sklearn.metrics import mutual_info_score

from placefield.baselines.fabmap import ChowLiuTree, learn_tree

Branches = set[frozenset[int]]


def branches_of(tree: ChowLiuTree) -> Branches:
    return {
        frozenset((word, int(parent))) for word, parent in enumerate(tree.parent) if word != parent
    }


def reachable(branches: tuple[tuple[int, int], ...]) -> set[int]:
    reached = {0}
    while True:
        grown = reached.union(*(branch for branch in branches if reached & set(branch)))
        if grown == reached:
            return reached
        reached = grown


def spanning_trees(words: int) -> Iterator[tuple[tuple[int, int], ...]]:
    for branches in combinations(combinations(range(words), 2), words - 1):
        if len(reachable(branches)) == words:
            yield branches


def depending_words(seed: int, frames: int, words: int) -> NDArray[np.bool_]:
    rng = np.random.default_rng(seed)
    hidden = rng.random((frames, 2)) < 0.4
    cause = rng.integers(0, 2, words)
    flipped = rng.random((frames, words)) < rng.uniform(0.05, 0.4, words)
    return np.asarray(hidden[:, cause] ^ flipped)


@pytest.mark.parametrize("words", [1, 2, 4, 5])
@pytest.mark.parametrize("seed", range(4))
def test_no_spanning_tree_holds_more_mutual_information(seed: int, words: int) -> None:
    observations = depending_words(seed, 4000, words)

    information = {
        frozenset(pair): float(mutual_info_score(*observations[:, pair].T))
        for pair in combinations(range(words), 2)
    }
    most = max(sum(information[frozenset(b)] for b in tree) for tree in spanning_trees(words))
    found = sum(information[branch] for branch in branches_of(learn_tree(observations)))
    assert found == pytest.approx(most, abs=1e-5)


def test_finds_the_tree_that_observations_were_drawn_from() -> None:
    parent = [0, 0, 0, 1, 1, 2, 5, 5]
    rng = np.random.default_rng(4)
    drawn = rng.random((5000, len(parent))) < 0.3
    for word in range(1, len(parent)):
        same = rng.random(len(drawn)) < 0.8
        drawn[same, word] = drawn[same, parent[word]]
    tree = learn_tree(drawn)
    assert branches_of(tree) == {frozenset((w, p)) for w, p in enumerate(parent) if w != p}
    np.testing.assert_allclose(tree.present, 0.3, atol=0.03)
    np.testing.assert_allclose(tree.present_given[:, 1:], [[0.06] * 7, [0.86] * 7], atol=0.04)


def test_probabilities_are_frequencies_with_half_a_frame_in_each_case() -> None:
    tree = learn_tree(np.array([[1, 1], [1, 1], [1, 0], [0, 0], [0, 0]], np.bool_))
    np.testing.assert_allclose(tree.present, [4 / 7, 3 / 7])
    np.testing.assert_allclose(tree.present_given, [[4 / 7, 0.5 / 3], [4 / 7, 2.5 / 4]])


def test_words_without_information_are_still_in_one_tree() -> None:
    observations = np.array(list(product([False, True], repeat=3)))
    assert len(branches_of(learn_tree(observations))) == 2


def test_every_word_comes_behind_its_parent() -> None:
    tree = learn_tree(depending_words(0, 50, 40))
    rank = np.argsort(tree.order)
    assert sorted(tree.order) == list(range(40))
    assert tree.parent[tree.order[0]] == tree.order[0]
    assert np.all(rank[tree.parent[tree.order[1:]]] < rank[tree.order[1:]])


def test_samples_are_distributed_as_the_tree_says() -> None:
    tree = learn_tree(depending_words(1, 60, 4))
    samples = tree.sample(40_000, seed=2)
    for case in product([0, 1], repeat=4):
        log_p = 0.0
        for word, parent in enumerate(tree.parent):
            present = tree.present_given[case[parent], word]
            log_p += log(present if case[word] else 1 - present)
        assert np.mean(np.all(samples == case, axis=1)) == pytest.approx(np.exp(log_p), abs=0.01)
    np.testing.assert_array_equal(samples, tree.sample(40_000, seed=2))
