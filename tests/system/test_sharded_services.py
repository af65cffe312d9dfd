"""A map's places spread over workers: together they answer as the whole map does."""

import signal
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from hosting import (
    Answer,
    Listener,
    Process,
    Smoothed,
    offline,
    smoothed_of,
    smoothed_offline,
    wait_until,
)

from placefield.bus.connecting import open_bus
from placefield.config import BusConfig
from placefield.maps.map import Map

CHANNELS = ("--channel", "0", "--channel", "1", "--channel", "2")
SHARDS = 3


class ShardedHost:
    """A router, a featurizer, a fuser, and a worker for each shard."""

    def __init__(self, stack: ExitStack, folder: Path, endpoint: str, map_path: Path) -> None:
        self._stack, self._folder, self._map_path = stack, folder, map_path
        self._bus = ("--endpoint", endpoint)
        router = stack.enter_context(Process(folder, "router", *self._bus))
        wait_until(lambda: "ready" in router.out, "the router is ready")
        self.start("featurizer")
        self.start("fuser")
        self.workers = [self.start_shard(shard) for shard in range(SHARDS)]
        bus = stack.enter_context(open_bus(BusConfig(endpoint=endpoint)))
        self.listener = Listener(bus)
        wait_until(lambda: self.listener.alive("fuser"), "the services are ready")

    def start(self, service: str, *flags: str) -> Process:
        command = service, self._map_path, *flags, *self._bus
        return self._stack.enter_context(Process(self._folder, *command))

    def start_shard(self, shard: int) -> Process:
        return self.start("channel", *CHANNELS, "--shard", f"{shard}/{SHARDS}")

    def replay(self, source: Path, *flags: str) -> Process:
        command = "replay", source, *self._bus, *flags
        return self._stack.enter_context(Process(self._folder, *command))


@pytest.fixture
def host(tmp_path: Path, endpoint: str, map_path: Path) -> Iterator[ShardedHost]:
    with ExitStack() as stack:
        yield ShardedHost(stack, tmp_path, endpoint, map_path)


def places_and_scores(answers: list[Answer]) -> list[tuple[int, float]]:
    return [(match.place, match.score) for _, match in answers]


def assert_close(smoothed: list[Smoothed], expected: list[Smoothed]) -> None:
    """Check that frames, places, lags and flags are the same, and probabilities to rounding."""
    assert [(*one[:2], *one[3:]) for one in smoothed] == [(*one[:2], *one[3:]) for one in expected]
    for (_, _, probability, *_), (_, _, known, *_) in zip(smoothed, expected, strict=True):
        assert probability == pytest.approx(known, abs=1e-5)


def test_shards_answer_as_the_whole_and_so_does_one_that_was_killed_and_started_again(
    host: ShardedHost, route_map: Map, query_dir: Path
) -> None:
    whole = offline(route_map, sorted(query_dir.iterdir()))
    host.replay(query_dir)
    answers = host.listener.answers()
    assert not any(match.missing for _, match in answers)
    assert [place for place, _ in places_and_scores(answers)] == [place for place, *_ in whole]
    for (_, score), (_, expected, _) in zip(places_and_scores(answers), whole, strict=True):
        assert score == pytest.approx(expected, abs=1e-3)

    in_hindsight = smoothed_of(host.listener.smoothed(answers[0][0].stream))
    assert_close(in_hindsight, smoothed_offline(route_map, sorted(query_dir.iterdir())))

    replay = host.replay(query_dir, "--rate", "12")
    first = host.listener.answers(count=15)
    host.workers[1].stop(signal.SIGKILL)
    first += host.listener.until_flagged(first=15)
    with replay.paused():
        host.start_shard(1)
        wait_until(lambda: len(host.listener.alive("channel")) == SHARDS * 3, "the shard is back")
    again = [*first, *host.listener.answers(first=len(first))]
    assert len(again) == len(whole)
    assert smoothed_of(host.listener.smoothed(again[0][0].stream)) == in_hindsight
    assert any(match.missing for _, match in again)
    assert not again[-1][1].missing
    for (_, answer), known in zip(again, answers, strict=True):
        assert answer.missing in ((), (0, 1, 2))
        if not answer.missing:
            assert (answer.place, answer.score) == (known[1].place, known[1].score)
