"""Rerun's recordings as its own reader reads them."""

import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from made_matches import ALL_KINDS, KNOWN, SMOOTHED, STAMPS_NS, UNTOLD, VERIFIED, stream_of

from placefield.maps.geography import Origin
from placefield_tools.record.recorder_files import recorder_of

chunks_of_file = pytest.importorskip("rerun.chunk")

ORIGIN = Origin(47.5, 8.5)
Row = tuple[int, int, Any]  # number of the frame, its stamp, what was logged


def read(path: Path) -> dict[str, list[Row]]:
    """Return what there is of each entity, by the frame's number."""
    rows: dict[str, list[Row]] = defaultdict(list)
    for chunk in chunks_of_file.RrdReader(path).stream():
        if chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        (values,) = (name for name in batch.schema.names if ":" in name and "media" not in name)
        for frame, stamp, value in zip(
            batch["frame"].to_pylist(), batch["stamp"].cast("int64"), batch[values], strict=True
        ):
            rows[str(chunk.entity_path)].append((frame, stamp.as_py(), value.as_py()))
    return {entity: sorted(found, key=lambda row: row[0]) for entity, found in rows.items()}


@pytest.fixture(scope="module")
def jpeg() -> bytes:
    return cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory, jpeg: bytes) -> dict[str, list[Row]]:
    path = tmp_path_factory.mktemp("rerun") / "drive.rrd"
    with recorder_of(path, origin=ORIGIN, frames=True, precision=0.9) as recorder:
        for header, match in stream_of(ALL_KINDS):
            recorder.write_frame(header, jpeg)
            recorder.write_match(header, match)
    return read(path)


@pytest.mark.parametrize("name", ["place", "score", "probability", "known", "too_fast"])
def test_numbers_of_every_match_are_over_stamps_and_frames(
    drive: dict[str, list[Row]], name: str
) -> None:
    expected = [
        (number, STAMPS_NS[0] + 100_000_000 * number, [float(getattr(match, name))])
        for number, match in enumerate(ALL_KINDS)
        if getattr(match, name) is not None
    ]
    assert drive[f"/match/{name}"] == expected


def test_positions_are_of_all_matches_that_have_one_and_are_not_unknown(
    drive: dict[str, list[Row]],
) -> None:
    for (_, _, (point,)), (_, _, (degrees,)), match in zip(
        drive["/route/position"], drive["/earth/position"], (KNOWN, UNTOLD), strict=True
    ):
        assert match.pose is not None
        assert tuple(point) == (*match.pose[:2], 0)
        assert ORIGIN.to_local(*degrees) == pytest.approx(match.pose[:2], abs=1e-3)


def test_pictures_come_back_and_the_end_is_said(drive: dict[str, list[Row]], jpeg: bytes) -> None:
    assert [bytes(image[0]) for _, _, image in drive["/frame"]] == [jpeg] * 5
    assert drive["/stream"] == [(4, drive["/stream"][0][1], ["end of stream drive: 4 frames"])]


def test_the_precision_that_is_asked_for_is_beside_each_probability(
    drive: dict[str, list[Row]],
) -> None:
    assert [(frame, asked) for frame, _, asked in drive["/match/asked"]] == [(0, [0.9]), (1, [0.9])]


def layout_of(path: Path) -> dict[str, set[str]]:
    """Return the entities that each view of the layout in a file shows, by the view's name."""
    reader = chunks_of_file.RrdReader(path)
    [entry] = reader.blueprints()
    assert entry.application_id == reader.recordings()[0].application_id
    names, origins, contents = {}, {}, {}
    for chunk in reader.stream(store=entry):
        columns = chunk.to_record_batch().to_pydict()
        view = str(chunk.entity_path).removesuffix("/ViewContents")
        if "ViewBlueprint:display_name" in columns:
            [[names[view]]] = columns["ViewBlueprint:display_name"]
            [[origins[view]]] = columns["ViewBlueprint:space_origin"]
        if "ViewContents:query" in columns:
            [contents[view]] = columns["ViewContents:query"]
    return {
        name: {entity.removeprefix("+ ").replace("$origin/**", origins[view]) for entity in shown}
        for view, name in names.items()
        for shown in [contents[view]]
    }


@pytest.mark.parametrize("georeferenced", [True, False])
def test_the_layout_shows_what_is_in_the_file(
    tmp_path: Path, jpeg: bytes, georeferenced: bool
) -> None:
    path = tmp_path / "drive.rrd"
    of_each_kind = [(stream_of([KNOWN])[0][0], match) for match in (KNOWN, SMOOTHED, VERIFIED)]
    with recorder_of(path, origin=ORIGIN if georeferenced else None, frames=True) as recorder:
        for header, match in of_each_kind:
            recorder.write_match(header, match)
        recorder.write_frame(header, jpeg)
        recorder.write_place(header, jpeg)
    layout = layout_of(path)
    assert len(layout) == 5
    assert set().union(*layout.values()) <= set(read(path))
    assert {"/frame", "/place", "/match/asked"} <= set().union(*layout.values())
    assert any("/earth/position" in shown for shown in layout.values()) == georeferenced


def test_without_images_the_layout_has_no_room_for_them(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    with recorder_of(path) as recorder:
        recorder.write_match(*stream_of([KNOWN])[0])
    assert not {"/frame", "/place"} & set().union(*layout_of(path).values())


def test_rerun_s_own_program_finds_no_fault_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "drive.rrd"
    with recorder_of(path, origin=ORIGIN, frames=True) as recorder:
        for written in stream_of(ALL_KINDS):
            recorder.write_match(*written)
    rerun = [sys.executable, "-m", "rerun", "rrd", "verify", path]
    verified = subprocess.run(rerun, capture_output=True, text=True, timeout=60, check=False)
    assert verified.returncode == 0, verified.stderr
