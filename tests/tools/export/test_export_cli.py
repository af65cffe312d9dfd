"""From a recording and a map on disk to files, by the command."""

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from evo.tools.file_interface import read_tum_trajectory_file
from typer.testing import CliRunner, Result

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.errors import ConfigError, MapError, PlacefieldError
from placefield.maps.digest import NO_DIGEST
from placefield.maps.geography import Origin
from placefield.maps.manifest import read_identified
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_tools.cli.main import app
from placefield_tools.record.recorder_files import recorder_of
from placefield_tools.record.records import RecordingError

POSES = np.array([[2.0 * place, 0.5 * place, 0.1] for place in range(60)])


@pytest.fixture(scope="module")
def earth_map(tmp_path_factory: pytest.TempPathFactory, route_map: Map) -> Path:
    """The small map, as if its frames had had latitudes and longitudes."""
    places = dataclasses.replace(route_map.places, poses=POSES)
    path = tmp_path_factory.mktemp("earth") / "earth.pfmap"
    frame = Origin(47.5, 8.5).frame
    save_map(dataclasses.replace(route_map, places=places, pose_frame=frame), path)
    return path


def match(place: int, *, known: bool | None = True, **fields: object) -> MatchMessage:
    pose = tuple(POSES[place].tolist()) if place >= 0 else None
    return MatchMessage(map=NO_DIGEST, place=place, score=1.0, known=known, pose=pose, **fields)


DRIVE = (match(3), match(4, known=False), match(5), match(-1, known=None), match(6))


def recorded(map_path: Path, path: Path, *streams: Sequence[MatchMessage]) -> Path:
    """Record matches on a map."""
    digest = {"map": read_identified(map_path)[1]}
    with recorder_of(path) as recorder:
        for name, matches in zip(("first", "second"), streams, strict=False):
            for number, one in enumerate(matches):
                header = Header(stream=name, sequence=number, stamp_ns=number * 10**9)
                recorder.write_match(header, one.model_copy(update=digest))
    return path


def run_export(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


def refusal(kind: type[PlacefieldError], *arguments: str | Path) -> str:
    ended = run_export(*arguments)
    assert isinstance(ended.exception, kind), ended.output
    assert not ended.output
    assert "\n" not in str(ended.exception)
    return str(ended.exception)


@pytest.mark.parametrize("recording", ["drive.jsonl", "drive.csv"])
def test_of_a_frame_that_has_a_smoothed_match_that_one_is_exported(
    earth_map: Path, tmp_path: Path, recording: str
) -> None:
    drive, out = tmp_path / recording, tmp_path / "out.tum"
    digest = {"map": read_identified(earth_map)[1]}
    with recorder_of(drive) as recorder:
        for number, (at_once, later) in enumerate([(3, 4), (9, 5), (6, None)]):
            header = Header(stream="first", sequence=number, stamp_ns=number * 10**9)
            recorder.write_match(header, match(at_once).model_copy(update=digest))
            if later is not None:
                smoothed = SmoothedMessage(**match(later).model_dump() | digest, lag=2)
                recorder.write_match(header, smoothed)
    ended = run_export(drive, out, "--map", earth_map)
    assert ended.output == f"{out}: 3 of 3 matches\n"
    positions = read_tum_trajectory_file(out).positions_xyz
    assert np.allclose(positions[:, :2], POSES[[4, 5, 6], :2])


@pytest.mark.parametrize("recording", ["drive.jsonl", "drive.csv"])
@pytest.mark.parametrize(
    ("flags", "places"), [((), [3, 5, 6]), (("--all",), [3, 4, 5, 6])], ids=["known", "all"]
)
def test_known_matches_are_exported_and_all_if_asked_for(
    earth_map: Path, tmp_path: Path, recording: str, flags: Sequence[str], places: Sequence[int]
) -> None:
    drive, out = recorded(earth_map, tmp_path / recording, DRIVE), tmp_path / "out.tum"
    ended = run_export(drive, out, "--map", earth_map, *flags)
    assert ended.exit_code == 0, ended.output
    assert ended.output == f"{out}: {len(places)} of 5 matches\n"
    read = read_tum_trajectory_file(out)
    np.testing.assert_array_equal(read.positions_xyz[:, :2], POSES[places, :2])


@pytest.mark.parametrize("suffix", ["g2o", "tum", "geojson", "gpx"])
def test_every_format_is_written_again_alike(earth_map: Path, tmp_path: Path, suffix: str) -> None:
    drive = recorded(earth_map, tmp_path / "drive.jsonl", DRIVE)
    written = []
    for name in ("one", "other"):
        out = tmp_path / f"{name}.{suffix}"
        assert run_export(drive, out, "--map", earth_map).exit_code == 0
        written.append(out.read_bytes())
    assert written[0] == written[1]
    assert written[0]


def test_a_file_that_is_there_is_not_replaced(earth_map: Path, tmp_path: Path) -> None:
    drive, out = recorded(earth_map, tmp_path / "drive.jsonl", DRIVE), tmp_path / "out.tum"
    out.write_text("mine")
    assert "exists already" in refusal(RecordingError, drive, out, "--map", earth_map)
    assert out.read_text() == "mine"


def test_the_tolerance_widens_what_a_loop_closure_allows(earth_map: Path, tmp_path: Path) -> None:
    drive = recorded(earth_map, tmp_path / "drive.jsonl", DRIVE)
    information = []
    for tolerance in ("1", "4"):
        out = tmp_path / f"out-{tolerance}.g2o"
        assert run_export(drive, out, "--map", earth_map, "--tolerance", tolerance).exit_code == 0
        edge = next(line for line in out.read_text().splitlines() if line.startswith("EDGE_SE2"))
        information.append(float(edge.split(" ")[6]))
    assert information[0] > 2 * information[1]


def test_of_several_streams_one_is_to_be_named(earth_map: Path, tmp_path: Path) -> None:
    drive = recorded(earth_map, tmp_path / "drive.jsonl", DRIVE, [match(9), match(10)])
    out = tmp_path / "out.tum"
    asked = refusal(RecordingError, drive, out, "--map", earth_map)
    named = "name one of its streams with --stream: first (5 matches), second (2 matches)"
    assert asked == f"{drive}: {named}"
    for stream, what in (("x", "no stream begins with 'x'"), ("", "2 streams begin with ''")):
        asked = refusal(RecordingError, drive, out, "--map", earth_map, "--stream", stream)
        assert asked == f"{drive}: {what}; {named}"
    assert run_export(drive, out, "--map", earth_map, "--stream", "sec").exit_code == 0
    assert len(out.read_text().splitlines()) == 2


@pytest.mark.parametrize("recording", ["drive.jsonl", "drive.csv"])
def test_a_recording_of_another_map_is_refused_though_its_places_lie_alike(
    earth_map: Path, tmp_path: Path, recording: str
) -> None:
    other = tmp_path / "other.pfmap"
    save_map(dataclasses.replace(open_map(earth_map), seed=99), other)
    drive, out = recorded(other, tmp_path / recording, DRIVE), tmp_path / "out.tum"
    refused = refusal(MapError, drive, out, "--map", earth_map)
    assert str(earth_map) in refused
    assert "that was matched against" in refused
    assert not out.exists()
    assert run_export(drive, out, "--map", other).exit_code == 0


def test_what_cannot_be_exported_is_refused_in_one_line_with_what_to_do(
    earth_map: Path, map_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = ("--map", earth_map)
    drive = recorded(earth_map, tmp_path / "drive.jsonl", DRIVE)
    empty = recorded(earth_map, tmp_path / "empty.jsonl")
    untold = recorded(earth_map, tmp_path / "untold.jsonl", [match(3, known=None)])
    other = recorded(
        earth_map,
        tmp_path / "other.jsonl",
        [MatchMessage(map=NO_DIGEST, place=3, score=0, known=True)] * 2,
    )
    beyond = recorded(
        earth_map,
        tmp_path / "beyond.csv",
        [MatchMessage(map=NO_DIGEST, place=60, score=0, known=True)],
    )
    moved = recorded(
        earth_map,
        tmp_path / "moved.csv",
        [MatchMessage(map=NO_DIGEST, place=3, score=0, known=True, pose=(0, 0, 0))],
    )
    out = tmp_path / "out.tum"
    assert ".g2o, .tum, .geojson, .gpx" in refusal(ConfigError, drive, tmp_path / "out.kml", *at)
    assert "holds no matches" in refusal(RecordingError, empty, out, *at)
    assert "--all" in refusal(RecordingError, untold, out, *at)
    assert "frames with poses" in refusal(MapError, drive, out, "--map", map_path)
    for one in (beyond, moved):
        assert "that was matched against" in refusal(MapError, one, out, *at)
    assert not out.exists()
    assert run_export(other, out, *at).exit_code == 0
    monkeypatch.setitem(sys.modules, "gpxpy", None)
    monkeypatch.setitem(sys.modules, "gpxpy.gpx", None)
    monkeypatch.delitem(sys.modules, "placefield_tools.export.gpx", raising=False)
    asked = refusal(ConfigError, drive, tmp_path / "out.gpx", *at)
    assert "pip install 'placefield[record]'" in asked


def test_matches_at_places_without_a_pose_are_left_out_and_counted(
    earth_map: Path, route_map: Map, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    poses = POSES.copy()
    poses[[4, 5]] = np.nan
    gappy = tmp_path / "gappy.pfmap"
    places = dataclasses.replace(route_map.places, poses=poses)
    frame = Origin(47.5, 8.5).frame
    save_map(dataclasses.replace(route_map, places=places, pose_frame=frame), gappy)
    nowhere = MatchMessage(map=NO_DIGEST, place=5, score=1.0, known=True)
    drive = recorded(gappy, tmp_path / "drive.jsonl", [match(3), nowhere, match(6)])
    for suffix in ("tum", "g2o", "geojson", "gpx"):
        out = tmp_path / f"out.{suffix}"
        ended = run_export(drive, out, "--map", gappy)
        assert ended.exit_code == 0, ended.output
        assert "nan" not in out.read_text().lower()
        assert "1 of 3 matches are at places without a pose and are left out" in caplog.text
    alone = recorded(gappy, tmp_path / "alone.jsonl", [nowhere])
    reason = refusal(RecordingError, alone, tmp_path / "alone.tum", "--map", gappy)
    assert "1 of 1 matches are at places without a pose" in reason
