import base64
import json
import signal
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from hosting import Host, Listener, Process, placefield, refusal, wait_until
from mcap.reader import make_reader

from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.features.images import decode
from placefield.maps.manifest import ChangeRecord, read_identified
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_tools.record.records import Record, read_records


def match_fields(fields: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in fields.items() if value is not None}


def test_recordings_hold_what_was_on_the_bus(
    host: Host,
    listener: Listener,
    logs: Path,
    map_path: Path,
    query_dir: Path,
    tmp_path: Path,
) -> None:
    lines, mcap = tmp_path / "drive.jsonl", tmp_path / "drive.mcap"
    at = ("--endpoint", host.endpoint)
    with (
        Process(logs, "record", lines, *at) as lines_process,
        Process(logs, "record", mcap, "--frames", "--map", map_path, *at) as mcap_process,
        Process(logs, "listen", "--json", *at) as listen,
    ):
        both = (lines_process, mcap_process)
        wait_until(lambda: all("\n" in process.out for process in both), "both record")
        streams = []
        for _ in range(2):
            host.replay(query_dir, "--stride", "3")
            streams.append(listener.answers())
        wait_until(lambda: lines.read_text().count("\n") == 82, "all is recorded")
        assert listen.stop(signal.SIGINT) == 0
        assert [process.stop(signal.SIGINT) for process in both] == [0, 0]
        assert not lines_process.err + mcap_process.err
    assert lines_process.out.splitlines()[-1] == f"{lines}: 40 matches, 40 smoothed"
    assert mcap_process.out.splitlines()[-1] == f"{mcap}: 40 matches, 40 smoothed, 40 frames"

    sent = [Record(header, match) for stream in streams for header, match in stream]
    everything = read_records(lines)
    recorded = [each for each in everything if not isinstance(each.match, SmoothedMessage)]
    assert len(everything) == 2 * len(recorded)
    assert [record.match for record in recorded] == [record.match for record in sent]
    for record, original in zip(recorded, sent, strict=True):
        for name in ("stream", "sequence", "stamp_ns"):
            assert getattr(record.header, name) == getattr(original.header, name)
    printed = listen.out.splitlines()  # the two kinds come on keys of their own
    assert set(printed) <= set(lines.read_text().splitlines())
    assert len(printed) >= 41

    with mcap.open("rb") as file:
        messages = [
            (channel.topic, message.log_time, json.loads(message.data))
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False)
        ]
    objects = [read for topic, _, read in messages if topic == "/placefield/match"]
    smoothed = [read for topic, _, read in messages if topic == "/placefield/smoothed/match"]
    written = [match_fields(json.loads(line)) for line in lines.read_text().splitlines()]
    assert objects == [one for one in written if not one["smoothed"]]
    assert smoothed == [one for one in written if one["smoothed"]]
    thumbnail = open_map(map_path).places.thumbnail
    of_places = [read["data"] for topic, _, read in messages if topic == "/placefield/place"]
    answered = [one for one in objects if not one["end"]]
    assert [base64.b64decode(one) for one in of_places] == [
        thumbnail(one["place"]) for one in answered
    ]
    images = [read["data"] for topic, _, read in messages if topic == "/placefield/frame"]
    files = sorted(query_dir.iterdir())[::3]
    for image, file in zip(images, files * 2, strict=True):
        shown = cv2.imdecode(np.frombuffer(base64.b64decode(image), np.uint8), cv2.IMREAD_COLOR)
        assert shown is not None
        assert np.abs(shown.astype(int) - decode(file.read_bytes())).mean() < 5


def test_a_recording_with_a_map_follows_its_versions_and_leaves_other_maps_out(
    host: Host, listener: Listener, logs: Path, route_map: Map, tmp_path: Path
) -> None:
    path, drive, run, other = tmp_path / "route.pfmap", tmp_path / "drive.mcap", "own", "a" * 16
    places = replace(route_map.places, poses=np.zeros((route_map.places.count, 3)))
    version = replace(route_map, places=places, pose_frame="wgs84 48.0 16.0")

    def put(before: list[str]) -> str:
        """Put a version at the path, whose history names those before; return its digest."""
        changes = [ChangeRecord(change="added", drive=each, before=each) for each in before]
        save_map(replace(version, history=tuple(changes)), path)
        return read_identified(path)[1]

    digests = [put([])]
    flags = ("--map", path, "--run", run, "--endpoint", host.endpoint)
    with Process(logs, "record", drive, *flags) as process:
        wait_until(lambda: "\n" in process.out, "it records")
        digests += [put(digests)]
        digests += [put(digests)]
        matches = listener.bus.publisher(Keys(run).match)
        for sequence, digest in enumerate([*digests, other]):
            header = Header(stream="s", sequence=sequence, stamp_ns=sequence)
            matches.put(header, MatchMessage(map=digest, place=1, score=0.0))
        wait_until(lambda: other in process.err, "the other map is refused")
        assert process.stop(signal.SIGINT) == 0
    assert process.out.splitlines()[-1] == f"{drive}: 3 matches, 0 smoothed"
    assert "1 matches of another map" in process.err


def test_a_recording_that_cannot_begin_leaves_no_file(
    host: Host, endpoint: str, map_path: Path, tmp_path: Path
) -> None:
    drive = tmp_path / "drive.mcap"
    soon = ("--set", "bus.connect_timeout_s=0.1")
    assert "no router at" in refusal(placefield("record", drive, "--endpoint", endpoint, *soon))
    asked = refusal(placefield("record", drive, "--map", map_path, "--endpoint", host.endpoint))
    assert "latitude and longitude" in asked
    assert asked.endswith("or leave --map out")
    assert not drive.exists()
