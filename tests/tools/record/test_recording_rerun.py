"""Rerun's recordings as its own reader reads them."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from made_matches import ALL_KINDS, KNOWN, STAMPS_NS, UNTOLD, stream_of

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
    with recorder_of(path, origin=ORIGIN, frames=True) as recorder:
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
