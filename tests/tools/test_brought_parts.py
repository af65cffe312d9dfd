"""Sources and recorders of another package."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.errors import ConfigError, SourceError
from placefield.maps.digest import NO_DIGEST
from placefield_tools.record.recorder_files import recorder_of
from placefield_tools.sources import open_source

Install = Callable[..., Path]

COUNTING = """
import numpy as np
from placefield import Frame
from placefield_tools.sources import Source


class Counting(Source):
    def __init__(self, count, start, stride):
        self.numbers = range(start, count, stride)
        self.count = len(self.numbers)

    def __iter__(self):
        for number in self.numbers:
            yield Frame(number, 0, f"number {number}", np.full((8, 8), number, np.uint8))


def open(where, *, start, stride, stop):
    return Counting(int(where.partition(":")[2]), start, stride)
"""

LIST = """
import json
from contextlib import contextmanager
from placefield_tools.record.recorder import Recorder


@contextmanager
def record(path, origin):
    places = []
    yield Recorder(lambda header, match: places.append(match.place))
    path.write_text(json.dumps(places))
"""


def test_a_source_of_another_package_is_opened_by_its_name(install: Install) -> None:
    install("countpack", COUNTING, {"placefield.sources": {"counting": "countpack:open"}})
    with open_source("counting:5") as source:
        assert [frame.image[0, 0] for frame in source] == [0, 1, 2, 3, 4]
    with open_source(["counting:2", "counting:3"]) as source:
        assert [frame.image[0, 0] for frame in source] == [0, 1, 0, 1, 2]


def test_a_folder_of_that_name_is_a_folder(
    install: Install, query_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(
        "folderpack", "raise RuntimeError", {"placefield.sources": {"counting": "folderpack:open"}}
    )
    (tmp_path / "counting:5").symlink_to(query_dir)
    monkeypatch.chdir(tmp_path)
    with open_source("counting:5") as source:
        assert source.count == 60


def test_a_broken_source_is_one_line_and_a_missing_one_is_no_source(install: Install) -> None:
    install(
        "brokenpack", "raise RuntimeError", {"placefield.sources": {"broken": "brokenpack:open"}}
    )
    with pytest.raises(ConfigError, match="source 'broken': brokenpack brings it"):
        open_source("broken:1")
    with pytest.raises(SourceError, match="no such folder or file"):
        open_source("missing:1")


def test_a_recorder_of_another_package_is_chosen_by_the_suffix(
    install: Install, tmp_path: Path
) -> None:
    install("listpack", LIST, {"placefield.recorders": {"places": "listpack:record"}})
    path = tmp_path / "drive.places"
    with recorder_of(path) as recorder:
        for place in (4, 2):
            header = Header(stream="one", sequence=0, stamp_ns=0)
            recorder.write_match(header, MatchMessage(map=NO_DIGEST, place=place, score=1.0))
    assert json.loads(path.read_text()) == [4, 2]


def test_a_recorder_that_holds_no_pictures_is_not_given_any(
    install: Install, tmp_path: Path
) -> None:
    install("blindpack", LIST, {"placefield.recorders": {"places": "blindpack:record"}})
    with (
        pytest.raises(ConfigError, match=r"--frames: a recording \.places holds no images"),
        recorder_of(tmp_path / "drive.places", frames=True),
    ):
        pass


def test_a_suffix_that_nobody_brings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"use \.jsonl, \.csv, \.mcap or \.rrd"):
        recorder_of(tmp_path / "drive.places")
