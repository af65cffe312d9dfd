"""Describers that hang and are killed in the midst of a stream: nothing is lost, nothing wrong."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import cycle, islice, pairwise
from pathlib import Path

import psutil
import pytest
from hosting import Host, Listener, answers_of, offline, smoothed_of, smoothed_offline, wait_until

import placefield
from placefield.maps.map import Map

FRAMES = 240

Fault = Callable[[], object]


@pytest.fixture(scope="module")
def host(logs: Path, map_path: Path) -> Iterator[Host]:
    with Host(logs, map_path, "--workers", "1", "--describers", "2") as running:
        yield running


@pytest.fixture
def images(query_dir: Path) -> list[Path]:
    return list(islice(cycle(sorted(query_dir.iterdir())), FRAMES))


def sent(images: Sequence[Path], faults: Mapping[int, Fault]) -> Iterator[Path]:
    """Yield images; do each fault before its frame, while the frames before it are under way."""
    for number, image in enumerate(images):
        if number in faults:
            faults[number]()
        yield image


def describer(host: Host) -> psutil.Process:
    return host.service("describer")[0]


def test_whatever_happens_to_describers_and_featurizer_every_answer_is_as_without_them(
    host: Host, listener: Listener, route_map: Map, images: list[Path]
) -> None:
    stopped: list[psutil.Process] = []

    def stop() -> None:
        stopped.append(describer(host))
        stopped[0].suspend()

    def kill_featurizer() -> None:
        wait_until(lambda: listener.count("featurizer", "described_here"), "it is counted")
        host.service("featurizer")[0].kill()

    faults: dict[int, Fault] = {
        50: lambda: describer(host).kill(),
        100: stop,
        150: lambda: stopped[0].resume(),
        190: kill_featurizer,
    }
    with placefield.connect(host.endpoint) as client:
        matches = list(client.stream(sent(images, faults)))
    answers = listener.answers()
    assert answers_of(answers) == offline(route_map, images)
    assert smoothed_of(listener.smoothed(answers[0][0].stream)) == smoothed_offline(
        route_map, images
    )
    assert len(matches) == len(images)
    wait_until(lambda: len(listener.alive("describer")) == 2, "both are back")
    assert listener.count("describer", "received") > FRAMES / 3
    assert host.err.count("was ended by SIGKILL; starting it again") == 2
    assert "defect" not in host.err


def test_a_live_stream_goes_on_in_order_while_a_describer_is_killed(
    host: Host, listener: Listener, images: list[Path]
) -> None:
    pause = threading.Event()

    def camera() -> Iterator[Path]:
        for image in sent(images, {FRAMES // 2: lambda: describer(host).kill()}):
            yield image
            pause.wait(1 / 30)

    before = listener.count("describer", "received")
    with placefield.connect(host.endpoint) as client:
        matches = list(client.stream(camera(), live=True))
    assert len(matches) == FRAMES
    answered = []
    while (received := listener.next_match())[1] is not None:
        answered.append(received[0].sequence)
    assert all(earlier < later for earlier, later in pairwise(answered))
    assert answered[-1] > FRAMES - 10
    wait_until(lambda: listener.count("describer", "received") > before, "describers took part")
