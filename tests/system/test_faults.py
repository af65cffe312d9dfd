"""Services that are killed or stopped in the midst of a stream: nothing is lost, nothing wrong."""

import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from hosting import (
    Host,
    Listener,
    Process,
    Smoothed,
    answers_of,
    offline,
    smoothed_of,
    smoothed_offline,
    wait_until,
)

from placefield.bus.connecting import open_bus
from placefield.config import BusConfig
from placefield.maps.map import Map

RATE = "12"
"""Frames a second: a service that was killed is back before the last of them."""

LAPS = 6
"""How often the route is driven in a stream that is as fast as the services are."""

CHANNELS = ("--channel", "0", "--channel", "1", "--channel", "2")

BEFORE = 15
"""Frames that are answered before the fault."""


@pytest.fixture(scope="module")
def host(logs: Path, map_path: Path) -> Iterator[Host]:
    with Host(logs, map_path, "--workers", "3") as running:
        yield running


@pytest.fixture(scope="module")
def undisturbed(route_map: Map, query_dir: Path) -> list[tuple[int, float, tuple[int, ...]]]:
    return offline(route_map, sorted(query_dir.iterdir()))


@pytest.fixture(scope="module")
def smoothed(route_map: Map, query_dir: Path) -> list[Smoothed]:
    return smoothed_offline(route_map, sorted(query_dir.iterdir()))


@contextmanager
def replaying(
    endpoint: str, frames: Path, logs: Path, rate: str | None = RATE
) -> Iterator[Process]:
    """Replay inside the block, and to its end; without a rate as fast as it is answered."""
    limit = () if rate is None else ("--rate", rate)
    command = "replay", frames, *limit, "--endpoint", endpoint
    with Process(logs, *command) as replay:
        yield replay
        wait_until(lambda: not replay.runs, "the replay is over")
        assert " frames replayed" in replay.out, replay.err


@pytest.mark.parametrize("service", ["featurizer", "fuser"])
def test_a_service_that_is_killed_costs_no_frame_and_no_bit_of_an_answer(
    tmp_path: Path,
    host: Host,
    query_dir: Path,
    undisturbed: list[tuple[int, float, tuple[int, ...]]],
    smoothed: list[Smoothed],
    service: str,
) -> None:
    with host.listener() as listener, replaying(host.endpoint, query_dir, tmp_path):
        first = listener.answers(count=BEFORE)
        (process,) = host.service(service)
        process.kill()
        answers = first + listener.answers(first=BEFORE)
        assert smoothed_of(listener.smoothed(answers[0][0].stream)) == smoothed
    assert answers_of(answers) == undisturbed


@pytest.mark.parametrize("service", ["featurizer", "fuser"])
def test_a_service_that_is_killed_in_a_backlog_costs_no_frame_and_no_bit_of_an_answer(
    tmp_path: Path, host: Host, route_map: Map, query_dir: Path, service: str
) -> None:
    laps = tmp_path / "laps"
    laps.mkdir()
    frames = sorted(query_dir.iterdir()) * LAPS
    linked = [laps / f"{number:04}.jpg" for number in range(len(frames))]
    for link, frame in zip(linked, frames, strict=True):
        link.symlink_to(frame)
    with host.listener() as listener, replaying(host.endpoint, laps, tmp_path, rate=None):
        first = listener.answers(count=BEFORE)
        for process in host.service(service):
            process.kill()
        answers = first + listener.answers(first=BEFORE)
        smoothed = smoothed_of(listener.smoothed(answers[0][0].stream))
    assert answers_of(answers) == offline(route_map, linked)
    assert smoothed == smoothed_offline(route_map, linked)


def test_if_all_caches_of_a_stream_are_killed_at_once_later_answers_are_marked_as_forgotten(
    tmp_path: Path,
    host: Host,
    query_dir: Path,
    undisturbed: list[tuple[int, float, tuple[int, ...]]],
) -> None:
    with host.listener() as listener, replaying(host.endpoint, query_dir, tmp_path):
        first = listener.answers(count=BEFORE)
        for service in ("featurizer", "fuser", "channel"):
            for process in host.service(service):
                process.kill()
        answers = first + listener.answers(first=BEFORE)
        *_, last = listener.smoothed(answers[0][0].stream)
    assert last[1].forgotten
    assert len(answers) == len(undisturbed)
    forgotten = [match.forgotten for _, match in answers]
    assert forgotten == sorted(forgotten)
    assert forgotten[-1]
    assert not forgotten[0]
    unflagged = forgotten.index(True)
    whole = [at for at in range(unflagged) if not answers[at][1].missing]
    assert whole
    assert [answers_of(answers)[at] for at in whole] == [undisturbed[at] for at in whole]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_without_a_channel_answers_are_flagged_and_once_it_is_back_they_are_as_ever(
    tmp_path: Path,
    host: Host,
    query_dir: Path,
    undisturbed: list[tuple[int, float, tuple[int, ...]]],
    smoothed: list[Smoothed],
    number: signal.Signals,
) -> None:
    with host.listener() as listener, replaying(host.endpoint, query_dir, tmp_path) as replay:
        first = listener.answers(count=BEFORE)
        (worker,) = host.service("channel", "--channel 1")
        worker.send_signal(number)
        first += listener.until_flagged(BEFORE)
        with replay.paused():
            if number == signal.SIGSTOP:
                worker.resume()
            wait_until(lambda: len(listener.alive("channel")) == 3, "the worker is back")
        answers = answers_of(first + listener.answers(first=len(first)))
        in_hindsight = smoothed_of(listener.smoothed(first[0][0].stream))
    assert [number for number, *_ in in_hindsight] == list(range(len(smoothed)))
    expected = [known for known, one in zip(smoothed, in_hindsight, strict=True) if not one[-1]]
    assert [one for one in in_hindsight if not one[-1]] == expected
    assert {one[-1] for one in in_hindsight} <= {(), (1,)}
    assert in_hindsight[-1] in expected
    flagged = [number for number, (_, _, missing) in enumerate(answers) if missing]
    assert len(answers) == len(undisturbed)
    assert flagged
    assert flagged == list(range(flagged[0], flagged[-1] + 1))
    assert flagged[0] >= BEFORE
    assert flagged[-1] < len(answers) - 1
    whole = [number for number in range(len(answers)) if number not in flagged]
    assert [answers[number] for number in whole] == [undisturbed[number] for number in whole]
    assert {answers[number][2] for number in flagged} == {(1,)}


def test_a_router_that_is_killed_costs_no_frame_and_no_bit_of_an_answer(
    tmp_path: Path,
    endpoint: str,
    map_path: Path,
    query_dir: Path,
    undisturbed: list[tuple[int, float, tuple[int, ...]]],
) -> None:
    services = ("featurizer", ()), ("fuser", ()), ("channel", CHANNELS)
    with ExitStack() as stack:
        router = stack.enter_context(Process(tmp_path, "router", "--endpoint", endpoint))
        wait_until(lambda: "ready" in router.out, "the router is ready")
        for service, flags in services:
            command = service, map_path, *flags, "--endpoint", endpoint
            stack.enter_context(Process(tmp_path, *command))
        bus = stack.enter_context(open_bus(BusConfig(endpoint=endpoint)))
        listener = Listener(bus)
        wait_until(lambda: listener.alive("fuser"), "the services are ready")
        with replaying(endpoint, query_dir, tmp_path):
            first = listener.answers(count=BEFORE)
            router.stop(signal.SIGKILL)
            stack.enter_context(Process(tmp_path, "router", "--endpoint", endpoint))
            answers = answers_of(first + listener.answers(first=BEFORE))
    whole = [answer for answer in answers if not answer[2]]
    assert len(answers) == len(undisturbed)
    assert whole == [
        known for known, answer in zip(undisturbed, answers, strict=True) if not answer[2]
    ]
    assert not answers[-1][2]
