import os
import re
import resource
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from shutil import copytree

import cv2
import numpy as np
import pytest
from command_lines import runner
from hosting import (
    Host,
    Listener,
    Process,
    answers_of,
    free_endpoint,
    offline,
    placefield,
    refusal,
    wait_until,
)

from placefield.bus.connecting import open_bus, open_router
from placefield.config import BusConfig, Config
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield_tools.build.map_from_sources import build_from

HURRIED = ("--set", "bus.connect_timeout_s=0.3")


def test_a_port_in_use_is_refused_and_its_router_continues(
    host: Host, listener: Listener, map_path: Path, query_dir: Path
) -> None:
    line = refusal(placefield("up", map_path, "--endpoint", host.endpoint))
    assert f"cannot listen at {host.endpoint}" in line
    assert "--endpoint" in line
    host.replay(query_dir, "--stride", "6")
    assert len(listener.answers()) == 10


@pytest.fixture
def refused_here(
    tmp_path: Path,
    map_path: Path,
    query_dir: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> Callable[..., str]:
    """Run a command that cannot begin in this process, and return the line that says why.

    Other tests start these commands as processes.
    """
    (tmp_path / "empty").mkdir()
    run = runner(tmp_path, monkeypatch, capfd)

    def refused(*command: str) -> str:
        return run(*(word.format(map=map_path, query=query_dir) for word in command)).refusal

    return refused


@pytest.mark.parametrize(
    "command",
    [
        ("featurizer", "{map}"),
        ("channel", "{map}", "--channel", "0"),
        ("fuser", "{map}"),
        ("serve", "{map}"),
        ("fetch", "route"),
        ("replay", "{query}"),
        ("listen",),
        ("status",),
    ],
    ids=lambda command: command[0],
)
def test_without_a_router_a_command_says_where_it_looked(
    refused_here: Callable[..., str], endpoint: str, command: tuple[str, ...]
) -> None:
    line = refused_here(*command, "--endpoint", endpoint, *HURRIED)
    assert f"no router at {endpoint}" in line
    assert "placefield up MAP" in line


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (("up", "no.pfmap"), "no.pfmap: no map there"),
        (("up", "{map}", "--endpoint", "7557"), "bus.endpoint '7557' is malformed"),
        (("listen", "--endpoint", "tcp:7557"), "bus.endpoint 'tcp:7557' is malformed"),
        (("up", "{map}", "--set", "bus.port=7557"), "setting bus.port"),
        (("up", "{map}", "--run", "two words"), "setting runs"),
        (("listen", "--run", "day,night"), "runs day, night: give one of them with --run"),
        (("replay", "{query}", "--run", "day,night"), "runs day, night: give one of them"),
        (("replay", "empty"), "empty: no image files"),
        (("serve", "no.pfmap"), "no.pfmap: no map there"),
        (("serve", "{map}", "{map}"), "two maps of one name; give each name once"),
        (
            ("fetch", "maps/route"),
            "'maps/route': give the name of a map; give its folder with --to",
        ),
        (
            ("describer", "{map}", "--part", "sift"),
            "--part sift: the map has no such feature; give",
        ),
        (("replay", "no-folder"), "no-folder: no such folder or file"),
        (("replay", "{query}", "--stride", "0"), "--stride 0: must be 1 or more"),
        (("replay", "{query}", "--start", "60"), "--start 60"),
        (("replay", "{query}", "--start", "-1"), "--start -1"),
        (("replay", "camera:99"), "camera:99: cannot be opened"),
    ],
)
def test_a_command_that_cannot_begin_says_why_in_one_line(
    refused_here: Callable[..., str], command: tuple[str, ...], reason: str
) -> None:
    assert reason in refused_here(*command)


def test_a_host_with_a_damaged_map_says_so_in_one_line(map_path: Path, tmp_path: Path) -> None:
    broken = copytree(map_path, tmp_path / "broken.pfmap")
    labels = broken / "channels" / "0" / "labels.npy"
    labels.write_bytes(labels.read_bytes() + b"\0")
    line = refusal(placefield("up", broken, "--endpoint", free_endpoint()))
    assert f"{labels}: damaged: its checksum is wrong" in line


def test_a_disk_that_fills_up_during_a_build_leaves_no_half_map(
    reference_dir: Path, map_path: Path, tmp_path: Path
) -> None:
    def limit_files_to_8_kb() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))

    flags = ("--channels", "1", "--metric", "identity", "--overwrite")
    target = copytree(map_path, tmp_path / "route.pfmap")
    before = (target / "manifest.json").read_bytes()
    built = placefield("build", reference_dir, "-o", target, *flags, preexec=limit_files_to_8_kb)
    assert built.returncode == 1
    *others, last = built.stderr.splitlines()
    assert f"{target}: cannot write the map: the disk is full" in last
    assert any("route.pfmap.building/channel-0-metric.npz: not kept: " in one for one in others)
    finished = f"{target.name}.building"  # for the next try
    assert {path.name for path in tmp_path.iterdir()} == {target.name, finished}
    assert (target / "manifest.json").read_bytes() == before


@pytest.mark.parametrize("service", ["featurizer", "fuser"])
def test_a_second_featurizer_or_fuser_on_a_run_is_refused_and_the_first_goes_on(
    host: Host, listener: Listener, map_path: Path, query_dir: Path, service: str
) -> None:
    line = refusal(placefield(service, map_path, "--endpoint", host.endpoint))
    assert f"run 'default' has a {service} already" in line
    assert "--run" in line
    host.replay(query_dir, "--stride", "6")
    assert {match.missing for _, match in listener.answers()} == {()}


def test_a_replay_to_a_run_without_services_says_what_is_missing(
    host: Host, query_dir: Path
) -> None:
    flags = ("--endpoint", host.endpoint, "--run", "another", *HURRIED)
    line = refusal(placefield("replay", query_dir, *flags))
    assert "run 'another' has no featurizer and no fuser" in line


def test_a_second_replay_on_a_run_is_refused(
    host: Host, listener: Listener, logs: Path, query_dir: Path
) -> None:
    at = ("--endpoint", host.endpoint)
    with Process(logs, "replay", query_dir, "--loop", "--rate", "10", *at) as first:
        listener.answers(count=2)
        assert "has a replay already" in refusal(placefield("replay", query_dir, *at))
        assert first.stop() == 0


def test_a_replay_says_how_many_frames_were_missing_observations_and_why(
    host: Host, listener: Listener, query_dir: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    good = [file.read_bytes() for file in sorted(query_dir.iterdir())[:6]]
    blank = cv2.imencode(".png", np.full((48, 64), 99, np.uint8))[1].tobytes()
    cut_off = good[2][:-2]
    for number, data in enumerate([good[0], cut_off, blank, good[3], b"", good[4]]):
        (folder / f"{number}.jpg").write_bytes(data)
    assert host.replay(folder).stdout == "6 frames replayed: 2 unreadable, 1 blank\n"
    assert len(listener.answers()) == 6
    assert host.replay(query_dir, "--stride", "6").stdout == "10 frames replayed\n"


def test_a_replay_of_which_no_frame_can_be_read_ends_with_code_1(
    host: Host, listener: Listener, query_dir: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for file in sorted(query_dir.iterdir())[:4]:
        (folder / file.name).write_bytes(file.read_bytes()[:-2])
    ended = placefield("replay", folder, "--endpoint", host.endpoint)
    assert ended.returncode == 1
    assert ended.stdout == "4 frames replayed: 4 unreadable\n"
    assert ended.stderr.splitlines()[-1].startswith(
        f"placefield: {folder}: none of its frames could"
    )
    assert len(listener.answers()) == 4


def test_a_damaged_video_is_replayed_with_all_its_turns_and_a_cut_off_one_says_what_it_lacks(
    host: Host, listener: Listener, tmp_path: Path
) -> None:
    whole, cut_off = a_video(tmp_path / "drive.mp4"), a_video(tmp_path / "cut_off.avi")
    data = bytearray(whole.read_bytes())
    data[len(data) // 4 : len(data) // 4 + 9000] = bytes(9000)
    whole.write_bytes(data)
    said = re.fullmatch(r"40 frames replayed: (\d+) unreadable\n", host.replay(whole).stdout)
    assert said is not None
    assert 0 < int(said[1]) < 20
    assert len(listener.answers()) == 40
    os.truncate(cut_off, cut_off.stat().st_size // 2)
    said = re.fullmatch(r"(\d+) frames replayed: (\d+) missing\n", host.replay(cut_off).stdout)
    assert said is not None
    assert int(said[1]) + int(said[2]) == 40


def a_video(path: Path) -> Path:
    """Write a video of 40 frames, no two alike."""
    codec = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, codec, 10, (64, 48))
    for frame in np.random.default_rng(1).integers(0, 256, (40, 48, 64, 3), np.uint8):
        writer.write(frame)
    writer.release()
    return path


def test_a_query_shorter_than_the_smallest_scale_is_answered(
    host: Host, listener: Listener, route_map: Map, query_dir: Path
) -> None:
    host.replay(query_dir, "--start", "58")
    assert answers_of(listener.answers()) == offline(route_map, sorted(query_dir.iterdir())[58:])


@contextmanager
def running_apart(
    logs: Path, commands: list[tuple[str, ...]], channels: int
) -> Iterator[tuple[Listener, str, list[Process]]]:
    """Run services, each by its own command, on a router of their own."""
    bus = BusConfig(endpoint=free_endpoint())
    with ExitStack() as stack:
        stack.enter_context(open_router(bus))
        listener = Listener(stack.enter_context(open_bus(bus)))
        at = ("--endpoint", bus.endpoint)
        processes = [stack.enter_context(Process(logs, *command, *at)) for command in commands]
        wait_until(lambda: len(listener.alive("channel")) == channels, "the channels")
        wait_until(lambda: listener.alive("featurizer"), "the featurizer")
        wait_until(lambda: listener.alive("fuser"), "the fuser")
        yield listener, bus.endpoint, processes


def test_descriptors_of_another_map_are_counted_and_answered_by_no_channel(
    logs: Path, made_up: Path, map_path: Path, reference_dir: Path, query_dir: Path
) -> None:
    config = Config.model_validate(
        {
            "features": {"kind": "grayscale"},
            "scales": {"channels": 1},
            "metric": {"kind": "identity"},
        }
    )
    other_map = made_up / "grayscale.pfmap"
    save_map(build_from([str(reference_dir)], config), other_map)
    flags = ("--set", "fusion.deadline_s=0.3")
    commands = [
        ("featurizer", str(other_map)),
        ("channel", str(map_path), "--channel", "0", "--channel", "1", "--channel", "2"),
        ("fuser", str(map_path), *flags),
    ]
    with running_apart(logs, commands, channels=3) as (listener, endpoint, processes):
        replayed = placefield("replay", query_dir, "--stride", "6", "--endpoint", endpoint)
        assert replayed.returncode == 0, replayed.stderr
        answers = listener.answers()
        assert [(match.place, match.missing) for _, match in answers] == [(-1, (0, 1, 2))] * 10
        wait_until(lambda: listener.count("channel", "other_map") >= 10, "they are counted")
        assert all(process.runs for process in processes)
        assert "give the featurizer the same map" in processes[1].err
        assert processes[1].err.count("\n") == 1  # once in a while is enough


def test_candidates_of_another_rule_are_counted_and_the_stream_goes_on(
    logs: Path, map_path: Path, query_dir: Path
) -> None:
    commands = [
        ("featurizer", str(map_path)),
        ("channel", str(map_path), "--channel", "0", "--channel", "1"),
        ("channel", str(map_path), "--channel", "2", "--rule", "ams"),
        ("fuser", str(map_path), "--deadline", "0.3"),
    ]
    with running_apart(logs, commands, channels=3) as (listener, endpoint, processes):
        replayed = placefield("replay", query_dir, "--stride", "6", "--endpoint", endpoint)
        assert replayed.returncode == 0, replayed.stderr
        assert {match.missing for _, match in listener.answers()} == {(2,)}
        wait_until(
            lambda: listener.count("fuser", "malformed") == 11, "they and the end are counted"
        )
        assert "give both one --rule" in processes[3].err
