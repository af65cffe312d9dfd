"""MCAP as its own library reads it, and the schemas as Foxglove documents them."""

import base64
import json
import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import jsonschema
import numpy as np
import pytest
from made_matches import (
    ALL_KINDS,
    KNOWN,
    OF_HEADER,
    SMOOTHED,
    STAMPS_NS,
    UNTOLD,
    VERIFIED,
    Written,
    stream_of,
)
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Message, Schema

from placefield.bus.message import Header
from placefield.maps.geography import Origin
from placefield_tools.record.recorder_files import recorder_of

ORIGIN = Origin(47.5, 8.5)

Read = dict[str, list[tuple[Schema, Message, dict[str, Any]]]]

DOCUMENTED = {
    "foxglove.PoseInFrame": {"timestamp", "frame_id", "pose"},
    "foxglove.LocationFix": {
        "timestamp",
        "frame_id",
        "latitude",
        "longitude",
        "altitude",
        "position_covariance",
        "position_covariance_type",
    },
    "foxglove.CompressedImage": {"timestamp", "frame_id", "data", "format"},
}
"""Fields of docs.foxglove.dev/docs/sdk/schemas."""


def recorded(
    path: Path,
    written: Sequence[Written],
    origin: Origin | None = None,
    jpeg: bytes | None = None,
) -> Read:
    with recorder_of(path, origin=origin, frames=jpeg is not None) as recorder:
        for header, match in written:
            if jpeg is not None:
                recorder.write_frame(header, jpeg)
            recorder.write_match(header, match)
    return read(path)


def read(path: Path) -> Read:
    by_topic: Read = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            assert channel.message_encoding == "json"
            by_topic[channel.topic].append((schema, message, json.loads(message.data)))
    return by_topic


@pytest.fixture(scope="module")
def jpeg() -> bytes:
    return cv2.imencode(".jpg", np.zeros((8, 8, 3), np.uint8))[1].tobytes()


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory, jpeg: bytes) -> Read:
    path = tmp_path_factory.mktemp("mcap") / "drive.mcap"
    return recorded(path, stream_of(ALL_KINDS), ORIGIN, jpeg)


def test_every_match_and_the_end_are_there_at_the_frames_stamps(drive: Read) -> None:
    objects = [read for _, _, read in drive["/placefield/match"]]
    for read, match in zip(objects, ALL_KINDS, strict=False):
        expected = json.loads(match.model_dump_json(exclude={"version"}, exclude_none=True))
        assert {name: read[name] for name in expected} == expected
        assert set(read) - set(expected) == OF_HEADER
    assert [read["sequence"] for read in objects] == [0, 1, 2, 3, 4]
    assert objects[-1]["end"] is True
    times = [message.log_time for _, message, _ in drive["/placefield/match"]]
    assert times[:3] == list(STAMPS_NS)


def test_poses_are_of_all_matches_that_have_one_and_are_not_unknown(drive: Read) -> None:
    poses = [read for _, _, read in drive["/placefield/pose"]]
    assert len(poses) == 2
    for read, match in zip(poses, (KNOWN, UNTOLD), strict=True):
        assert match.pose is not None
        x, y, yaw = match.pose
        assert read["pose"]["position"] == {"x": x, "y": y, "z": 0}
        q = read["pose"]["orientation"]
        turned = math.atan2(
            2 * (q["w"] * q["z"] + q["x"] * q["y"]), 1 - 2 * (q["y"] ** 2 + q["z"] ** 2)
        )
        assert turned == pytest.approx(yaw)
        assert math.hypot(*q.values()) == pytest.approx(1)
    assert poses[0]["timestamp"] == {"sec": 1_700_000_000, "nsec": 123_456_789}


def test_georeferenced_positions_are_those_of_the_poses(drive: Read) -> None:
    fixes = [read for _, _, read in drive["/placefield/location"]]
    for read, match in zip(fixes, (KNOWN, UNTOLD), strict=True):
        assert match.pose is not None
        assert ORIGIN.to_local(read["latitude"], read["longitude"]) == pytest.approx(
            match.pose[:2], abs=1e-3
        )


def test_pictures_come_back(drive: Read, jpeg: bytes) -> None:
    images = [read for _, _, read in drive["/placefield/frame"]]
    assert [base64.b64decode(read["data"]) for read in images] == [jpeg] * 5
    assert {read["format"] for read in images} == {"jpeg"}


def test_every_message_fits_its_schema_and_the_schemas_have_the_documented_fields(
    drive: Read,
) -> None:
    seen = set()
    for topic in drive.values():
        for schema, _, message in topic:
            seen.add(schema.name)
            assert schema.encoding == "jsonschema"
            described = json.loads(schema.data)
            strict = described | {"additionalProperties": False}
            jsonschema.Draft202012Validator.check_schema(strict)
            jsonschema.validate(message, strict)
            if schema.name in DOCUMENTED:
                assert set(message) == set(described["properties"]) == DOCUMENTED[schema.name]
    assert seen == {"placefield.Match", *DOCUMENTED}


def test_the_schemas_keep_to_what_foxglove_can_parse(drive: Read) -> None:
    """Its reader throws at a field of no type or of several, as a number or null."""

    def check(schema: dict[str, Any]) -> None:
        assert schema["type"] == "object"
        for field in schema["properties"].values():
            if "oneOf" in field:
                assert all(isinstance(one["const"], int) for one in field["oneOf"])
            elif field["type"] == "object":
                check(field)
            else:
                item = field["items"] if field["type"] == "array" else field
                assert item["type"] in ("boolean", "string", "number", "integer")

    for topic in drive.values():
        check(json.loads(topic[0][0].data))


def test_without_an_origin_there_are_no_georeferenced_positions(tmp_path: Path) -> None:
    drive = recorded(tmp_path / "drive.mcap", stream_of(ALL_KINDS))
    assert set(drive) == {"/placefield/match", "/placefield/pose"}


def test_smoothed_and_verified_matches_have_topics_of_their_own(tmp_path: Path) -> None:
    about = Header(stream="s", sequence=0, stamp_ns=0)
    drive = recorded(tmp_path / "drive.mcap", [(about, SMOOTHED)])
    assert set(drive) == {"/placefield/smoothed/match", "/placefield/smoothed/pose"}
    assert drive["/placefield/smoothed/match"][0][2]["lag"] == SMOOTHED.lag
    drive = recorded(tmp_path / "verified.mcap", [(about, VERIFIED)])
    assert set(drive) == {"/placefield/verified/match", "/placefield/verified/pose"}
    assert drive["/placefield/verified/match"][0][2]["inliers"] == VERIFIED.inliers


def test_a_stamp_before_the_epoch_is_at_the_epoch(tmp_path: Path) -> None:
    early = Header(stream="s", sequence=0, stamp_ns=-5)
    drive = recorded(tmp_path / "drive.mcap", [(early, KNOWN)])
    (_, message, read), (_, _, pose) = (drive[f"/placefield/{t}"][0] for t in ("match", "pose"))
    assert (message.log_time, read["stamp_ns"]) == (0, -5)
    assert pose["timestamp"] == {"sec": 0, "nsec": 0}


def test_what_a_killed_recorder_leaves_is_readable_but_for_the_last_chunk(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    sequences = []
    stream = stream_of([KNOWN] * 1000)[:-1]
    with recorder_of(path) as recorder:
        for header, match in stream:
            recorder.write_match(header, match)
        with path.open("rb") as cut, pytest.raises(McapError):  # noqa: PT012 - up to the cut
            for _, channel, message in NonSeekingReader(cut).iter_messages(log_time_order=False):
                if channel.topic == "/placefield/match":
                    sequences.append(json.loads(message.data)["sequence"])
    assert sequences == list(range(len(sequences)))
    assert len(sequences) > 900
    assert len(read(path)["/placefield/match"]) == 1000
