import csv
import json
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from made_matches import (
    ALL_KINDS,
    KNOWN,
    OF_HEADER,
    SMOOTHED,
    UNVERIFIED,
    VERIFIED,
    headers,
    matches,
    stream_of,
)

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.maps.digest import NO_DIGEST
from placefield_tools.record.recorder_files import recorder_of
from placefield_tools.record.records import Record, RecordingError, as_object, read_records

WHOLE_FILE_EACH = settings(
    max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(params=[".jsonl", ".csv"])
def path(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / f"matches{request.param}"


def test_an_object_names_the_frame_and_has_every_field_of_the_match() -> None:
    header = Header(stream="s", sequence=4, stamp_ns=-1)
    assert as_object(header, KNOWN) == {
        "stream": "s",
        "sequence": 4,
        "stamp_ns": -1,
        "end": False,
        "smoothed": False,
        "verified": False,
        "map": NO_DIGEST,
        "place": 7,
        "score": 1 / 3,
        "missing": (),
        "probability": 0.999,
        "known": True,
        "too_fast": False,
        "forgotten": False,
        "pose": (1.5, -2.25, 0.5),
        "new": None,
    }


def test_a_recording_of_before_it_was_reported_is_of_matches_that_are_not_too_fast(
    tmp_path: Path,
) -> None:
    path = tmp_path / "matches.csv"
    path.write_text("stream,sequence,stamp_ns,place,score\ns,0,0,1,2\n")
    [record] = read_records(path)
    assert record.match == MatchMessage(map=NO_DIGEST, place=1, score=2.0)
    assert not record.match.too_fast


def test_json_lines_have_a_line_for_each_match_and_the_end(tmp_path: Path) -> None:
    path = tmp_path / "matches.jsonl"
    stream = stream_of(ALL_KINDS)
    with recorder_of(path) as recorder:
        for header, match in stream:
            recorder.write_match(header, match)
    parsed = [json.loads(line) for line in path.read_text().splitlines()]
    assert [one["sequence"] for one in parsed] == [0, 1, 2, 3, 4]
    assert [one["end"] for one in parsed] == [False] * 4 + [True]
    for one, match in zip(parsed, ALL_KINDS, strict=False):
        assert one["pose"] == (list(match.pose) if match.pose else None)
        assert (one["place"], one["score"], one["known"]) == (
            match.place,
            match.score,
            match.known,
        )
    assert set(parsed[-1]) == OF_HEADER


def test_a_smoothed_match_says_so_and_how_many_frames_later(path: Path) -> None:
    header = Header(stream="s", sequence=4, stamp_ns=-1)
    assert as_object(header, SMOOTHED)["smoothed"] is True
    assert as_object(header, SMOOTHED)["lag"] == SMOOTHED.lag
    written = [(header, KNOWN), (header, SMOOTHED)]
    with recorder_of(path) as recorder:
        for each in written:
            recorder.write_match(*each)
    assert read_records(path) == [Record(*each) for each in written]


def test_a_verified_match_says_so_and_what_geometry_says(path: Path) -> None:
    header = Header(stream="s", sequence=4, stamp_ns=-1)
    assert as_object(header, VERIFIED)["verified"] is True
    assert as_object(header, VERIFIED)["smoothed"] is False
    written = [(header, VERIFIED), (header, UNVERIFIED), (header, SMOOTHED)]
    with recorder_of(path) as recorder:
        for each in written:
            recorder.write_match(*each)
    assert read_records(path) == [Record(*each) for each in written]


def test_csv_has_a_row_for_each_match_and_empty_cells_for_what_there_is_not(
    tmp_path: Path,
) -> None:
    path = tmp_path / "matches.csv"
    with recorder_of(path) as recorder:
        for header, match in stream_of(ALL_KINDS):
            recorder.write_match(header, match)
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["place"] for row in rows] == ["7", "9", "3", "-1"]
    assert [row["known"] for row in rows] == ["true", "false", "", ""]
    assert [row["too_fast"] for row in rows] == ["false"] * 4
    assert [row["missing"] for row in rows] == ["", "", "0 12", "1"]
    assert [row["probability"] for row in rows] == ["0.999", "0.25", "", ""]
    assert [(row["x"], row["y"], row["yaw"]) for row in rows][::3] == [
        ("1.5", "-2.25", "0.5"),
        ("", "", ""),
    ]
    assert float(rows[0]["score"]) == 1 / 3
    assert rows[1]["stamp_ns"] == "1700000000223456789"


def test_what_is_read_back_is_what_was_written(path: Path) -> None:
    @WHOLE_FILE_EACH
    @given(st.lists(st.tuples(headers, matches), min_size=1, max_size=5))
    def check(written: list[tuple[Header, MatchMessage]]) -> None:
        path.unlink(missing_ok=True)
        with recorder_of(path) as recorder:
            for header, match in written:
                recorder.write_match(header, match)
        assert read_records(path) == [Record(header, match) for header, match in written]

    check()


def test_whatever_a_file_holds_it_is_read_or_refused(path: Path) -> None:
    header = "stream,sequence,stamp_ns,place,score,probability,known,too_fast,x,y,yaw,missing"

    @WHOLE_FILE_EACH
    @given(st.binary(max_size=200) | st.text(max_size=200).map(str.encode))
    @example(b"[1]\n")
    @example(b"null\n")
    @example(b"[" * 100_000 + b"\n")
    @example(b"9" * 5000 + b"\n")
    @example(b'{"end": true}\n')
    @example(f"{header}\na,0,0,1,2,3,4,5,6,7,8,9,10,11\n".encode())
    @example(f"{header}\na,0\n".encode())
    @example(f'{header}\n"a,0\n'.encode())
    @example(f"{header}\ns,0,0,1,nan,,,,,,,\n".encode())
    @example(f"{header}\ns,0,0,1,2,,,,1,,3,\n".encode())
    def check(content: bytes) -> None:
        path.write_bytes(content)
        with suppress(RecordingError):
            read_records(path)

    check()


def test_a_line_that_holds_no_match_is_named(tmp_path: Path) -> None:
    path = tmp_path / "matches.jsonl"
    with recorder_of(path) as recorder:
        recorder.write_match(*stream_of([KNOWN])[0])
    path.write_text(path.read_text() + '{"stream": "s", "sequence": 1, "stamp_ns": 0}\n')
    with pytest.raises(RecordingError, match=r"matches\.jsonl, line 2: .*'place': Field required"):
        read_records(path)


def test_a_last_line_that_was_cut_off_is_left_out_and_said(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with recorder_of(path) as recorder:
        for header, match in stream_of(ALL_KINDS)[:-1]:
            recorder.write_match(header, match)
    path.write_bytes(path.read_bytes()[:-3])
    assert [record.match for record in read_records(path)] == list(ALL_KINDS[:-1])
    assert "cut off" in caplog.text


def test_a_line_is_in_the_file_once_it_is_written(path: Path) -> None:
    """A recorder that is killed leaves what the file holds then."""
    with recorder_of(path) as recorder:
        for number, (header, match) in enumerate(stream_of(ALL_KINDS)[:-1]):
            recorder.write_match(header, match)
            assert [record.match for record in read_records(path)] == list(ALL_KINDS[: number + 1])


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="placefield record"):
        read_records(tmp_path / "drive.mcap")
