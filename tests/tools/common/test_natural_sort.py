"""The order of names, as people count."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield_tools.common.natural_sort import in_natural_order, natural_key


@given(st.lists(st.integers(0, 10**12), unique=True))
def test_natural_order_is_the_order_of_the_numbers(numbers: list[int]) -> None:
    files = in_natural_order(f"frame{number}.jpg" for number in numbers)
    assert files == [f"frame{number}.jpg" for number in sorted(numbers)]


@given(st.lists(st.integers(0, 10**15), unique=True), st.randoms())
def test_times_without_their_last_zeros_are_in_the_order_of_time(
    micros: list[int], rng: random.Random
) -> None:
    names = [f"image_{micro // 10**6}{_fraction(micro % 10**6)}.png" for micro in sorted(micros)]
    mixed = rng.sample(names, len(names))
    assert in_natural_order(mixed) == names


def _fraction(micro: int) -> str:
    return f".{micro:06}".rstrip("0").rstrip(".")


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(1, 30)), unique=True), st.randoms())
def test_chapters_are_in_the_order_of_both_numbers(
    chapters: list[tuple[int, int]], rng: random.Random
) -> None:
    chapters = sorted({*chapters, (1, 10)})  # one that counts to ten shows what they are
    names = [f"drive {chapter}.{part}.mp4" for chapter, part in chapters]
    assert in_natural_order(rng.sample(names, len(names))) == names


@pytest.mark.parametrize(
    "ordered",
    [
        ["v1.2.9.png", "v1.2.10.png", "v1.10.1.png"],
        ["photo.jpg", "photo (1).jpg", "photo (2).jpg", "photo (10).jpg"],
        ["20.jpg", "20.05.jpg", "20.45.jpg", "20.5.jpg", "21.jpg"],
        ["02.png", "2.png", "12.png", "a1b2.png", "a1b10.png", "b.png", "b1.png", "²3.png"],
    ],
)
def test_names_of_many_kinds_are_in_the_order_that_people_expect(ordered: list[str]) -> None:
    assert in_natural_order(reversed(ordered)) == ordered
    assert in_natural_order(sorted(ordered)) == ordered


def test_runs_are_named_in_natural_order() -> None:
    assert sorted(["run10", "run9"], key=natural_key) == ["run9", "run10"]
