"""Opening a map channel by channel."""

from pathlib import Path

import numpy as np
import pytest

from placefield.errors import MapError
from placefield.maps.opening import open_map


def spoil(file: Path) -> None:
    file.write_bytes(file.read_bytes() + b"\0")


def test_a_channel_that_is_not_asked_for_is_not_read(saved: Path) -> None:
    spoil(saved / "channels" / "1" / "labels.npy")
    opened = open_map(saved, [0])
    assert len(opened.channels) == 2
    assert len(opened.channels[0].labels) == opened.places.count
    with pytest.raises(MapError, match=r"1/labels.npy: damaged"):
        opened.channels[1]


def test_a_channel_that_is_asked_for_is_checked_at_once(saved: Path) -> None:
    spoil(saved / "channels" / "1" / "labels.npy")
    for channels in ([1], [0, 1], None):
        with pytest.raises(MapError, match=r"1/labels.npy: damaged"):
            open_map(saved, channels)


def test_without_channels_no_metric_is_read(saved: Path) -> None:
    for file in (saved / "metrics").rglob("*.npy"):
        spoil(file)
    assert len(open_map(saved, ()).channels) == 2


def test_a_channel_is_the_same_however_it_is_asked_for(saved: Path) -> None:
    opened = open_map(saved, ())
    assert opened.channels[1] is opened.channels[-1]
    assert opened.channels[:] == tuple(opened.channels)
    whole = open_map(saved)
    for one, other in zip(opened.channels, whole.channels, strict=True):
        np.testing.assert_array_equal(one.segments, other.segments)
    with pytest.raises(IndexError):
        opened.channels[2]


def test_a_number_that_no_channel_has_is_left_to_whoever_asks_for_it(saved: Path) -> None:
    assert len(open_map(saved, [7]).channels) == 2
