"""The check of a feature of another package, on good features and on one bad one of each kind."""

from collections.abc import Callable, Sequence
from itertools import count
from threading import get_ident, main_thread

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield import check_feature
from placefield.features.extract import feature_of

Pixels = NDArray[np.uint8]


def good(images: Sequence[Pixels]) -> NDArray[np.float32]:
    return np.array([[image.mean(), image.std(), image[0].mean()] for image in images], np.float32)


def test_a_good_feature_passes() -> None:
    check_feature(good)
    check_feature(good, [np.zeros((9, 9), np.uint8), np.eye(12, dtype=np.uint8)])


@pytest.mark.parametrize("kind", ["gist", "grayscale"])
def test_the_built_in_features_keep_the_same_contract(kind: str) -> None:
    describe = feature_of(kind).describe
    check_feature(lambda images: np.stack([describe(image) for image in images]))


def drifting() -> Callable[[Sequence[Pixels]], NDArray[np.float32]]:
    calls = count()
    return lambda images: good(images) + np.float32(next(calls))


def of_thread(images: Sequence[Pixels]) -> NDArray[np.float32]:
    return good(images) + np.float32(get_ident() != main_thread().ident)


def of_neighbours(images: Sequence[Pixels]) -> NDArray[np.float32]:
    return good(images) * np.float32(len(images))


def in_place(images: Sequence[Pixels]) -> NDArray[np.float32]:
    for image in images:
        image += 1
    return good(images)


def of_size(images: Sequence[Pixels]) -> NDArray[np.float32]:
    return np.stack([image.mean(axis=tuple(range(1, image.ndim))) for image in images]).astype("f4")


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (lambda images: good(images).astype(np.float64), "gives float64; it has to give"),
        (lambda images: good(images).tolist(), "gives list; it has to give an array of float32"),
        (lambda images: good(images)[0], r"gives shape \(3,\) for 1 images; .* \(B, D\)"),
        (lambda images: good(images) / np.float32(0), "gives numbers that are not finite"),
        (lambda images: good(images)[:, :1], "gives a single number"),
        (lambda images: np.ones((len(images), 3), np.float32), "gives one vector for different"),
        (of_size, r"gives vectors of \[48, 64, .*\] numbers for different images"),
        (drifting(), "gives another vector for an image after other images"),
        (of_thread, "gives another vector in several threads at once"),
        (of_neighbours, "gives other vectors in a batch: they differ by 4"),
    ],
)
def test_a_feature_that_breaks_the_contract_is_told_how(
    bad: Callable[[Sequence[Pixels]], NDArray[np.float32]], reason: str
) -> None:
    with np.errstate(divide="ignore"), pytest.raises(AssertionError, match=f"the feature {reason}"):
        check_feature(bad)


def test_a_feature_that_writes_into_its_images_fails() -> None:
    with pytest.raises(ValueError, match="read-only"):
        check_feature(in_place)
