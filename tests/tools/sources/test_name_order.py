"""Warnings about file names that are not in the order of the drive."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield_tools.common.natural_sort import in_natural_order
from placefield_tools.sources import open_source
from placefield_tools.sources.name_order import wrap_in


def order_of(folder: Path, names: list[str]) -> list[str]:
    for name in names:
        (folder / name).write_bytes(b"")
    return [frame.name.partition("/")[2] for frame in open_source(str(folder))]


@given(
    st.sampled_from(["DSC_", "IMG_", "2024-01-01 ", ""]),
    st.integers(3, 5),
    st.integers(2, 80),
    st.integers(2, 80),
    st.integers(1, 3),
    st.integers(0, 1),
)
def test_a_counter_that_wraps_is_seen_where_it_does(
    prefix: str, digits: int, before: int, after: int, step: int, least: int
) -> None:
    end = 10**digits
    numbers = [end - 1 - step * at for at in range(before)] + [
        least + step * at for at in range(after)
    ]
    files = in_natural_order(f"{prefix}{number:0{digits}}.JPG" for number in numbers)
    assert wrap_in(files) == after


def test_the_number_of_a_group_before_a_counter_is_none_of_it() -> None:
    assert wrap_in([f"G003{number:04}.JPG" for number in (0, 1, 2, 9998, 9999)]) == 3


@pytest.mark.parametrize(
    "numbers",
    [
        range(10_000),  # all of them
        range(200),
        range(9_800, 10_000),
        range(0, 10_000, 7),
        [*range(100), *range(5_000, 5_100)],
        [*range(100), *range(4_000, 4_100), *range(9_900, 10_000)],  # three drives
        [0],
        [],
    ],
)
def test_other_counters_have_not_wrapped(numbers: list[int]) -> None:
    assert wrap_in([f"IMG_{number:04}.jpg" for number in numbers]) is None


@pytest.mark.parametrize(
    "files", [["a.jpg", "b.jpg", "c.jpg"], ["A_000.jpg", "A_001.jpg", "B_998.jpg", "B_999.jpg"]]
)
def test_names_of_several_kinds_have_no_counter(files: list[str]) -> None:
    assert wrap_in(files) is None


def test_a_counter_that_wraps_is_reported_in_one_line_that_says_what_to_do(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    names = [f"DSC_{number % 10_000:04}.jpg" for number in range(9990, 10_010)]
    assert order_of(tmp_path, names)[0] == "DSC_0000.jpg"
    [line] = caplog.messages
    assert "DSC_9990.jpg" in line
    assert "frames.csv" in line
    (tmp_path / "frames.csv").write_text("\n".join(["file", *names]))
    caplog.clear()
    assert order_of(tmp_path, names) == names
    assert not caplog.messages


@pytest.mark.parametrize("copy", ["{} (1)", "{}(1)", "{} (12)", "{} copy", "{} - Copy", "{}_copy"])
def test_copies_come_right_after_what_they_are_of_and_are_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, copy: str
) -> None:
    copied = copy.format("IMG_5") + ".jpg"
    names = ["IMG_4.jpg", "IMG_5.jpg", copied, "IMG_6.jpg", "IMG_50.jpg"]
    assert order_of(tmp_path, names) == names
    [line] = caplog.messages
    assert f"1 of 5 files are named like copies of others, for example {copied!r}" in line


def test_numbers_in_brackets_alone_are_no_copies(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    names = [f"drive ({number}).jpg" for number in range(1, 12)]
    assert order_of(tmp_path, names) == names
    assert not caplog.messages
