"""What becomes of an open map when somebody writes to its files, and of its files with it."""

import gc
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from placefield.errors import MapError
from placefield.maps import array_files
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map

PLACES = "metrics/0/places.npy"


@pytest.fixture
def all_mapped(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a map whose files are all large."""
    monkeypatch.setattr(array_files, "_MAPPED_FROM", 0)


def overwrite(file: Path) -> None:
    with file.open("r+b") as opened:
        opened.seek(200)
        opened.write(bytes(50))


def truncate(file: Path) -> None:
    os.truncate(file, 150)


def lengthen(file: Path) -> None:
    with file.open("ab") as opened:
        opened.write(b"more")


@pytest.mark.parametrize("change", [overwrite, truncate, lengthen])
def test_a_small_file_may_change_while_its_map_is_open(
    saved: Path, change: Callable[[Path], None]
) -> None:
    opened = open_map(saved)
    before = opened.metrics[0].places.copy()
    change(saved / PLACES)
    np.testing.assert_array_equal(opened.metrics[0].places, before)
    opened.check_unchanged()


@pytest.mark.usefixtures("all_mapped")
@pytest.mark.parametrize("change", [overwrite, truncate, lengthen])
def test_a_mapped_file_that_is_written_to_is_reported_by_its_name(
    saved: Path, change: Callable[[Path], None]
) -> None:
    opened = open_map(saved)
    opened.check_unchanged()
    change(saved / PLACES)
    with pytest.raises(MapError, match=rf"^{saved / PLACES}: was written to while in use"):
        opened.check_unchanged()


@pytest.mark.usefixtures("all_mapped")
def test_a_file_of_a_channel_that_was_not_opened_may_change(saved: Path) -> None:
    opened = open_map(saved, [0])
    lengthen(saved / "channels" / "1" / "labels.npy")
    opened.check_unchanged()


@pytest.mark.usefixtures("all_mapped")
def test_a_map_that_was_built_again_leaves_the_one_that_is_open(
    saved: Path, small_map: Map
) -> None:
    opened = open_map(saved)
    before = opened.metrics[0].places.copy()
    save_map(small_map, saved)
    opened.check_unchanged()
    np.testing.assert_array_equal(opened.metrics[0].places, before)
    assert not open_map(saved).places.poses.size


@pytest.mark.usefixtures("all_mapped")
def test_a_mapped_array_is_the_one_that_is_read(saved: Path, posed_map: Map) -> None:
    opened = open_map(saved)
    np.testing.assert_array_equal(opened.metrics[0].places, posed_map.metrics[0].places)
    assert not opened.metrics[0].places.flags.writeable


def test_a_map_that_lies_in_memory_cannot_change(posed_map: Map) -> None:
    posed_map.check_unchanged()


@pytest.mark.usefixtures("all_mapped")
@pytest.mark.parametrize("is_damaged", [False, True])
@pytest.mark.filterwarnings("error")
def test_no_file_is_left_open_when_a_map_is_gone_or_refused(saved: Path, is_damaged: bool) -> None:
    if is_damaged:
        overwrite(saved / PLACES)
    gc.collect()  # maps of tests before this one
    before = os.listdir("/proc/self/fd")
    if is_damaged:
        with pytest.raises(MapError, match="damaged"):
            open_map(saved)
    else:
        open_map(saved)
    gc.collect()
    assert len(os.listdir("/proc/self/fd")) == len(before)
