"""A new version of a map replaces the served one while frames stream: none is lost or wrong."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from hosting import Answer, Host, Listener, answers_of, offline, wait_until
from map_versions import version_of

from placefield import connect
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.config import Config
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.recognizer import Recognizer

MOST = 3000
"""Frames of a stream at most: a takeover that has not come by then does not come."""

FAST = 300
"""Frames at full rate. Later ones are slow: the replay caches have the last 1000, and a new version
gives the library's bits only if it can match the stream from its first frame on."""

Stream = tuple[list[Answer], list[tuple[int, SmoothedMessage]]]


@pytest.fixture
def served(tmp_path: Path, map_path: Path) -> Path:
    return Path(copytree(map_path, tmp_path / "served.pfmap"))


def put_version(placemap: Map, reference: Path, number: int, path: Path) -> Map:
    """Replace the map at a path by another version; return it."""
    save_map(version_of(placemap, reference, number), path)
    return open_map(path)


def drive(
    host: Host, listener: Listener, images: Sequence[Path], look: Callable[[Answer], bool]
) -> Stream:
    """Stream images, again and again, until ``look`` at an answer says so; return all answers."""
    is_over, answers = False, list[Answer]()

    def frames() -> Iterator[Path]:
        for number in range(MOST):
            if is_over:
                return
            if number >= FAST or (answers and answers[-1][1].missing):
                time.sleep(0.05)
            yield images[number % len(images)]

    with connect(host.endpoint) as client:
        for _ in client.stream(frames()):
            answers += listener.answers(first=len(answers), count=1)
            is_over = look(answers[-1]) or is_over
    assert is_over, "no takeover"
    return answers, listener.smoothed(answers[0][0].stream)


class Replacing:
    """Replaces the served map by one version after another, each a while after the last."""

    EVERY = 60

    def __init__(self, versions: Sequence[Callable[[], Map]], first: Map) -> None:
        self._waiting, self.put = list(versions), [first]
        self._in_a_row = 0

    def __call__(self, answer: Answer) -> bool:
        """Look at an answer; True some whole answers after the last version has come."""
        is_newest = answer[1].map == self.put[-1].digest and not answer[1].missing
        self._in_a_row = self._in_a_row + 1 if is_newest else 0
        if self._in_a_row < self.EVERY:
            return False
        if not self._waiting:
            return True
        self.put.append(self._waiting.pop(0)())
        self._in_a_row = 0
        return False


def check(stream: Stream, versions: Sequence[Map], images: Sequence[Path]) -> None:
    """Check that each answer is that of the library with the version that the answer names."""
    answers, smoothed = stream
    frames = [images[number % len(images)].read_bytes() for number in range(len(answers))]
    assert [match.map for _, match in answers] == sorted_by(versions, answers)
    assert [number for number, _ in smoothed] == list(range(len(frames)))
    found = dict(smoothed)
    for version in versions:
        recognizer = Recognizer(version, Config())
        expected = [recognizer.update(frame) for frame in frames]
        own = whole_by(version, enumerate(match for _, match in answers))
        assert own, f"version {version.digest} answered nothing"
        assert [answers[number][1].match for number in own] == [expected[n] for n in own]
        of_version = whole_by(version, smoothed)
        hindsight = {one.frame: one for one in recognizer.smoothed() + recognizer.finish()}
        assert [found[n].match for n in of_version] == [hindsight[n].match for n in of_version]
        assert [found[n].lag for n in of_version] == [hindsight[n].lag for n in of_version]


def whole_by(version: Map, matches: Iterable[tuple[int, MatchMessage]]) -> list[int]:
    """Return the frames that a version has answered with all channels."""
    return [n for n, match in matches if match.map == version.digest and not match.missing]


def sorted_by(versions: Sequence[Map], answers: Sequence[Answer]) -> list[str]:
    """Return the maps of answers in the order of versions."""
    order = [version.digest for version in versions]
    return sorted((match.map for _, match in answers), key=order.index)


def test_two_new_versions_take_over_while_frames_stream_and_no_answer_is_lost_or_wrong(
    logs: Path, served: Path, route_map: Map, reference_dir: Path, query_dir: Path
) -> None:
    images = sorted(query_dir.iterdir())
    versions = [partial(put_version, route_map, reference_dir, number, served) for number in (1, 2)]
    replacing = Replacing(versions, route_map)
    with Host(logs, served, "--workers", "2") as host, host.listener() as listener:
        stream = drive(host, listener, images, replacing)
        assert "defect" not in host.err
        wait_until(lambda: listener.count("fuser", "matches") == len(stream[0]), "all is counted")
        assert listener.count("fuser", "partial") == 0
    check(stream, replacing.put, images)


@pytest.mark.parametrize("service", ["channel", "fuser"])
def test_a_service_that_is_killed_before_the_takeover_comes_back_and_no_frame_is_lost_or_wrong(
    logs: Path, served: Path, route_map: Map, reference_dir: Path, query_dir: Path, service: str
) -> None:
    images = sorted(query_dir.iterdir())
    with Host(logs, served, "--workers", "2") as host, host.listener() as listener:

        def kill_and_put() -> Map:
            version = put_version(route_map, reference_dir, 1, served)
            host.service(service)[0].kill()
            return version

        replacing = Replacing([kill_and_put], route_map)
        stream = drive(host, listener, images, replacing)
        assert "was ended by SIGKILL; starting it again" in host.err
    check(stream, replacing.put, images)


def test_a_map_of_another_model_is_not_taken_over_and_each_service_says_so_once(
    logs: Path, served: Path, route_map: Map, query_dir: Path
) -> None:
    images = sorted(query_dir.iterdir())
    with Host(logs, served, "--workers", "1") as host, host.listener() as listener:
        model = replace(route_map.model, mean=np.array(route_map.model.mean) + 1)
        save_map(replace(route_map, model=model), served)
        refused = f"{served}: is no version of the served map: "
        wait_until(lambda: host.err.count(refused) == 2, "worker and fuser say so")
        host.replay(query_dir)
        assert answers_of(listener.answers()) == offline(route_map, images)
        lines = [line for line in host.err.splitlines() if refused in line]
    assert len(lines) == 2
    assert all(line.endswith(f"; serving version {route_map.digest} on") for line in lines)
