import json
import signal
import time
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest
from hosting import (
    UNREADABLE,
    Host,
    Listener,
    Process,
    answers_of,
    free_endpoint,
    offline,
    placefield,
    smoothed_of,
    smoothed_offline,
    wait_until,
)

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.bus.verified_messages import VerifiedMessage
from placefield.config import BusConfig, Rule
from placefield.features.images import decode
from placefield.maps.digest import NO_DIGEST
from placefield.maps.map import Map


def connected(process: Process, endpoint: str) -> bool:
    """Return whether a process has reached the router, so that it receives messages."""
    port = int(endpoint.rpartition(":")[2])
    connections = psutil.Process(process.pid).net_connections()
    return any(c.raddr and c.raddr.port == port and c.status == "ESTABLISHED" for c in connections)


def test_the_stream_gives_what_is_given_offline_frame_for_frame(
    host: Host, listener: Listener, route_map: Map, damaged_dir: Path
) -> None:
    files = sorted(damaged_dir.iterdir())
    unreadable = listener.count("featurizer", "unreadable")
    assert "60 frames replayed" in host.replay(damaged_dir).stdout
    stream = listener.answers()
    assert answers_of(stream) == offline(route_map, files)
    smoothed = smoothed_of(listener.smoothed(stream[0][0].stream))
    assert smoothed == smoothed_offline(route_map, files)
    assert len({lag for *_, lag, _ in smoothed}) > 1
    wait_until(
        lambda: listener.count("featurizer", "unreadable") >= unreadable + len(UNREADABLE),
        "unreadable frames are counted",
    )


@pytest.mark.parametrize("rule", ["evidence", "ams"])
def test_so_does_the_stream_under_the_rules_that_are_not_the_default(
    logs: Path, map_path: Path, route_map: Map, damaged_dir: Path, rule: Rule
) -> None:
    with Host(logs, map_path, "--rule", rule) as own, own.listener() as listener:
        own.replay(damaged_dir)
        stream = listener.answers()
        smoothed = smoothed_of(listener.smoothed(stream[0][0].stream))
    answers, files = answers_of(stream), sorted(damaged_dir.iterdir())
    assert answers == offline(route_map, files, rule)
    assert smoothed == smoothed_offline(route_map, files, rule)
    assert sum(place >= 0 for place, _, _ in answers) > 40


def test_nothing_of_one_replay_is_left_for_the_next(
    host: Host, listener: Listener, query_dir: Path
) -> None:
    streams = []
    for _ in range(2):
        host.replay(query_dir)
        streams.append(listener.answers())
    assert answers_of(streams[0]) == answers_of(streams[1])
    names = [{header.stream for header, _ in stream} for stream in streams]
    assert len(names[0]) == len(names[1]) == 1
    assert names[0] != names[1]


def test_start_and_stride_choose_the_frames(
    host: Host, listener: Listener, route_map: Map, query_dir: Path
) -> None:
    host.replay(query_dir, "--start", "11", "--stride", "2", "--rate", "200")
    stream = listener.answers()
    assert answers_of(stream) == offline(route_map, sorted(query_dir.iterdir())[11::2])
    assert stream[3][0].stamp_ns == (11 + 3 * 2) * 100_000_000


def test_a_loop_runs_until_it_is_stopped(
    host: Host, listener: Listener, logs: Path, query_dir: Path
) -> None:
    arguments = ("--loop", "--start", "50", "--endpoint", host.endpoint)
    with Process(logs, "replay", query_dir, *arguments) as replay:
        listener.answers(count=25)  # of 10 frames
        assert replay.stop(signal.SIGINT) == 0
        sent = int(replay.out.split()[0])
    while listener.next_match()[1] is not None:
        pass  # what is still under way would come to the next test's listener
    assert sent >= 25
    assert "Traceback" not in replay.err


def test_a_video_is_replayed(
    host: Host, listener: Listener, route_map: Map, query_dir: Path, tmp_path: Path
) -> None:
    video = tmp_path / "query.avi"
    pixels = [decode(file.read_bytes()) for file in sorted(query_dir.iterdir())[:20]]
    height, width = pixels[0].shape[:2]
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 10, (width, height))
    for frame in pixels:
        writer.write(frame)
    writer.release()
    host.replay(video)
    capture = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)
    decoded = [np.asarray(capture.read()[1], np.uint8) for _ in pixels]
    capture.release()
    assert answers_of(listener.answers()) == offline(route_map, decoded)


def test_listen_prints_a_line_for_each_match_or_json_lines(
    host: Host, listener: Listener, logs: Path, query_dir: Path, route_map: Map
) -> None:
    with (
        Process(logs, "listen", "--endpoint", host.endpoint) as lines,
        Process(logs, "listen", "--json", "--endpoint", host.endpoint) as json_lines,
    ):
        both = (lines, json_lines)
        wait_until(lambda: all(connected(p, host.endpoint) for p in both), "both are connected")
        time.sleep(0.5)  # a subscription needs a moment to get around
        host.replay(query_dir, "--stride", "6")
        stream = listener.answers()
        smoothed = listener.smoothed(stream[0][0].stream)
        wait_until(lambda: all(p.out.count("\n") == 21 for p in both), "all is printed")
        assert [process.stop(signal.SIGINT) for process in both] == [0, 0]
        assert not lines.err + json_lines.err
        printed = lines.out.splitlines()
        parsed = [json.loads(line) for line in json_lines.out.splitlines()]
    at_once = [line for line in printed[:-1] if not line.startswith("  smoothed ")]
    later = [line for line in printed[:-1] if line.startswith("  smoothed ")]
    for number, (header, match) in enumerate(stream):
        assert at_once[number].startswith(f"frame {number}: place {match.place}, score ")
        assert [one for one in parsed if not one["smoothed"]][number] == {
            "stream": header.stream,
            "sequence": number,
            "stamp_ns": header.stamp_ns,
            "end": False,
            "smoothed": False,
            "verified": False,
            "map": route_map.digest,
            "place": match.place,
            "score": match.score,
            "missing": [],
            "probability": match.probability,
            "known": match.known,
            "too_fast": False,
            "forgotten": False,
            "pose": None,
            "new": None,
        }
    for number, one in smoothed:
        assert later[number].startswith(f"  smoothed frame {number}: place {one.place}, score ")
        assert later[number].endswith(f", {one.lag} frames later")
        later_line = [each for each in parsed if each["smoothed"]][number]
        assert (later_line["place"], later_line["lag"], later_line["end"]) == (
            one.place,
            one.lag,
            False,
        )
    assert printed[-1].startswith("end of stream")
    assert printed[-1].endswith("10 frames")
    assert parsed[-1]["end"] is True
    assert parsed[-1]["sequence"] == 10


def test_listen_says_where_the_place_is_which_channels_are_missing_and_what_is_too_fast(
    logs: Path, endpoint: str
) -> None:
    bus = BusConfig(endpoint=endpoint)
    sent = [
        MatchMessage(map=NO_DIGEST, place=7, score=1.5, pose=(1.0, -2.5, 0.25)),
        MatchMessage(map=NO_DIGEST, place=-1, score=0.0, missing=(0, 3)),
        MatchMessage(
            map=NO_DIGEST, place=7, score=-2.0, probability=0.125, known=False, too_fast=True
        ),
    ]
    with open_router(bus) as router, Process(logs, "listen", "--endpoint", endpoint) as listen:
        wait_until(lambda: connected(listen, endpoint), "listen is connected")
        time.sleep(0.5)  # a subscription needs a moment to get around
        matches = router.publisher(Keys("default").match)
        for sequence, match in enumerate(sent):
            matches.put(Header(stream="s", sequence=sequence, stamp_ns=0), match)
        wait_until(lambda: listen.out.count("\n") == len(sent), "all are printed")
        verified = router.publisher(Keys("default").verified)
        for sequence, about in enumerate([{"inliers": 41, "ratio": 12.5}, {"reason": "no_frame"}]):
            message = VerifiedMessage(map=NO_DIGEST, place=7, score=1.5, lag=2, **about)
            verified.put(Header(stream="s", sequence=sequence, stamp_ns=0), message)
        wait_until(lambda: listen.out.count("\n") == len(sent) + 2, "all are printed")
        assert listen.stop() == 0
        assert listen.out.splitlines() == [
            "frame 0: place 7, score 1.50, at x 1.00 m, y -2.50 m, yaw 0.25 rad",
            "frame 1: no place, score 0.00, without channels 0, 3",
            "frame 2: place 7, score -2.00, faster than the map resolves, 12.5 %",
            "  verified frame 0: place 7, score 1.50, 2 frames later, "
            "41 inliers, 12.5 times as likely",
            "  verified frame 1: place 7, score 1.50, 2 frames later, "
            "not verified: its frame is not kept",
        ]


def test_status_names_every_service(host: Host, listener: Listener, query_dir: Path) -> None:
    host.replay(query_dir, "--stride", "6")
    status = placefield("status", "--endpoint", host.endpoint)
    assert status.returncode == 0, status.stderr
    alive = set().union(
        *(listener.alive(service) for service in ("featurizer", "channel", "fuser"))
    )
    assert len(alive) == 1 + 3 + 1
    for token in alive:
        assert token.rpartition("/")[2] in status.stdout
    assert "matches" in status.stdout


def test_services_started_each_by_its_own_command_make_a_chain_partial_where_one_is_missing(
    logs: Path, map_path: Path, route_map: Map, query_dir: Path
) -> None:
    bus = BusConfig(endpoint=free_endpoint())
    at = ("--endpoint", bus.endpoint)
    with ExitStack() as stack:
        enter = stack.enter_context
        enter(open_router(bus))
        listener = Listener(enter(open_bus(bus)))
        enter(Process(logs, "featurizer", map_path, *at))
        enter(Process(logs, "channel", map_path, "--channel", "0", "--channel", "1", *at))
        wait_until(lambda: len(listener.alive("channel")) == 2, "two channels")
        # It waits as long for the channels as for the router.
        soon = ("--set", "bus.connect_timeout_s=3")
        enter(Process(logs, "fuser", map_path, "--deadline", "0.5", *soon, *at))
        wait_until(lambda: listener.alive("fuser"), "the fuser")

        replayed = placefield("replay", query_dir, *at)
        assert replayed.returncode == 0, replayed.stderr
        partial = listener.answers()
        assert len(partial) == 60
        assert {match.missing for _, match in partial} == {(2,)}
        assert [match.place for _, match in partial][-1] in range(56, 60)

        enter(Process(logs, "channel", map_path, "--channel", "2", *at))
        wait_until(lambda: len(listener.alive("channel")) == 3, "three channels")
        placefield("replay", query_dir, *at)
        whole = answers_of(listener.answers())
    assert whole == offline(route_map, sorted(query_dir.iterdir()))


def test_a_frame_whose_channel_stops_answering_is_answered_at_the_deadline(
    logs: Path, map_path: Path, query_dir: Path
) -> None:
    """A worker that hangs, unlike one that died, keeps its token for a while."""
    flags = ("--workers", "3", "--set", "fusion.deadline_s=0.3")
    with Host(logs, map_path, *flags) as own, own.listener() as listener:
        (worker,) = own.service("channel", "--channel 1")
        worker.suspend()
        try:
            own.replay(query_dir, "--stride", "6")
        finally:
            worker.resume()
        assert [match.missing for _, match in listener.answers()] == [(1,)] * 10


def test_while_a_channel_worker_is_killed_every_frame_is_answered(
    logs: Path, map_path: Path, route_map: Map, query_dir: Path
) -> None:
    files = sorted(query_dir.iterdir())
    rate = ("--rate", "15")  # 4 s: time to die and to come back
    with Host(logs, map_path, "--workers", "2") as own, own.listener() as listener:
        at = ("--endpoint", own.endpoint)
        with Process(logs, "replay", query_dir, *rate, *at) as replay:
            before = listener.answers(count=12)
            (victim,) = own.service("channel", "--channel 0")
            victim.kill()
            wait_until(lambda: not replay.runs, "the replay is over")
            assert "60 frames replayed" in replay.out, replay.err
        after = listener.answers(first=12)
        assert len(before + after) == 60
        assert answers_of(before) == offline(route_map, files)[:12]
        missing = {match.missing for _, match in after}
        assert (0,) in missing
        assert set().union(*missing) == {0}

        wait_until(lambda: len(listener.alive("channel")) == 3, "the worker is back")
        own.replay(query_dir)
        assert answers_of(listener.answers()) == offline(route_map, files)
