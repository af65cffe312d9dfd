"""A new version of a map replaces the served one while frames stream: none is lost or wrong."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import groupby
from pathlib import Path
from shutil import copytree

import pytest
from hosting import Answer, Host, Listener, wait_until
from map_versions import version_of

from placefield import connect
from placefield.bus.messages import SmoothedMessage
from placefield.config import Config
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.recognizer import Recognizer

MOST = 3000
"""Frames of a stream at most: a takeover that has not come by then does not come."""

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
    is_over = False

    def frames() -> Iterator[Path]:
        for number in range(MOST):
            if is_over:
                return
            yield images[number % len(images)]

    answers: list[Answer] = []
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
        """Look at an answer; True some frames after the last version has come."""
        is_newest = answer[1].map == self.put[-1].digest
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
        own = [number for number, (_, match) in enumerate(answers) if match.map == version.digest]
        assert own, f"version {version.digest} answered nothing"
        assert [answers[number][1].match for number in own] == [expected[n] for n in own]
        of_version = [(n, match) for n, match in smoothed if match.map == version.digest]
        hindsight = {one.frame: one for one in recognizer.smoothed() + recognizer.finish()}
        assert [found[n].match for n, _ in of_version] == [
            hindsight[n].match for n, _ in of_version
        ]
        assert [m.lag for _, m in of_version] == [hindsight[n].lag for n, _ in of_version]


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
    print(len(stream[0]), [(k[:4], len(list(g))) for k, g in groupby(m.map for _, m in stream[0])])
    check(stream, replacing.put, images)
