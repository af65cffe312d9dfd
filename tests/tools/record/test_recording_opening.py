import sys
from pathlib import Path

import pytest

from placefield.errors import ConfigError, MapError
from placefield.maps.geography import Origin
from placefield_tools.record.georeference import origin_of
from placefield_tools.record.recorder_files import recorder_of
from placefield_tools.record.records import RecordingError

ORIGIN = Origin(47.5, 8.5)


@pytest.mark.parametrize("name", ["drive", "drive.json", "drive.bag"])
def test_an_unknown_kind_of_recording_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=r"\.jsonl, \.csv, \.mcap or \.rrd"):
        recorder_of(tmp_path / name)


@pytest.mark.parametrize("suffix", ["jsonl", "csv", "mcap", "rrd"])
def test_a_file_that_is_there_is_not_written_over(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"drive.{suffix}"
    path.write_text("precious")
    with pytest.raises(RecordingError, match="exists already"):
        recorder_of(path)
    assert path.read_text() == "precious"


@pytest.mark.parametrize("suffix", ["jsonl", "csv", "mcap", "rrd"])
def test_no_file_is_made_before_it_is_recorded_into(tmp_path: Path, suffix: str) -> None:
    recorder_of(tmp_path / f"drive.{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", ["jsonl", "csv"])
def test_text_holds_no_pictures_and_no_georeferenced_positions(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"drive.{suffix}"
    with pytest.raises(ConfigError, match="--frames"):
        recorder_of(path, frames=True)
    with pytest.raises(ConfigError, match="--map"):
        recorder_of(path, origin=ORIGIN)


@pytest.mark.parametrize(
    ("suffix", "library", "extra"), [("mcap", "mcap", "record"), ("rrd", "rerun", "rerun")]
)
def test_without_its_library_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, library: str, extra: str
) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == library]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, library, None)
    for module in ("mcap_file", "rerun_file"):
        monkeypatch.delitem(sys.modules, f"placefield_tools.record.{module}", raising=False)
    with pytest.raises(ConfigError, match=rf"{library}.*pip install 'placefield\[{extra}\]'"):
        recorder_of(tmp_path / f"drive.{suffix}")


def test_the_origin_of_a_map_that_is_not_georeferenced_is_refused_with_what_to_do() -> None:
    path = Path("route.pfmap")
    assert origin_of(ORIGIN.frame, path, "leave it") == ORIGIN
    for frame, what in (("route", "its poses are in 'route'"), (None, "it has no poses")):
        with pytest.raises(MapError, match=f"route.pfmap: .*{what}; .*longitude.*, or leave it$"):
            origin_of(frame, path, "leave it")
