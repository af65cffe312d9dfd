import base64
import json
import signal
from pathlib import Path

import cv2
import numpy as np
from hosting import Host, Listener, Process, placefield, refusal, wait_until
from mcap.reader import make_reader

from placefield.bus.messages import SmoothedMessage
from placefield.features.images import decode
from placefield_tools.record.records import Record, read_records


def match_fields(fields: dict[str, object]) -> dict[str, object]:
    return {name: value for name, value in fields.items() if value is not None}


def test_recordings_hold_what_was_on_the_bus(
    host: Host, listener: Listener, logs: Path, query_dir: Path, tmp_path: Path
) -> None:
    lines, mcap = tmp_path / "drive.jsonl", tmp_path / "drive.mcap"
    at = ("--endpoint", host.endpoint)
    with (
        Process(logs, "record", lines, *at) as lines_process,
        Process(logs, "record", mcap, "--frames", *at) as mcap_process,
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
    images = [read["data"] for topic, _, read in messages if topic == "/placefield/frame"]
    files = sorted(query_dir.iterdir())[::3]
    for image, file in zip(images, files * 2, strict=True):
        shown = cv2.imdecode(np.frombuffer(base64.b64decode(image), np.uint8), cv2.IMREAD_COLOR)
        assert shown is not None
        assert np.abs(shown.astype(int) - decode(file.read_bytes())).mean() < 5


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
