from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import pytest

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage, StatsMessage
from placefield.bus.session import Bus
from placefield.maps.digest import NO_DIGEST
from placefield.maps.map import Map
from placefield_tools.dashboard.feed import Feed, Newest
from placefield_tools.dashboard.state import LiveState

KEYS = Keys("day")


class FakeBus:
    """Hands messages to the subscribers at once."""

    def __init__(self) -> None:
        self.receive: dict[str, Callable[[Received], None]] = {}
        self.receive_raw: dict[str, Callable[[str, bytes], None]] = {}
        self.change: Callable[[str, bool], None] = lambda key, is_alive: None

    def subscribe(
        self,
        key: str,
        receive: Callable[[Received], None],
        counts: Counter[str],
        *,
        ends_empty: bool = True,
    ) -> None:
        self.receive[key] = receive

    def subscribe_raw(self, key: str, receive: Callable[[str, bytes], None]) -> None:
        self.receive_raw[key] = receive

    def watch_alive(self, key: str, change: Callable[[str, bool], None]) -> None:
        self.change = change

    def log_dropped(self, key: str, error: Exception) -> None:
        pass

    def put(self, key: str, sequence: int, payload: bytes) -> None:
        header = Header(stream="s", sequence=sequence, stamp_ns=0)
        self.receive[key](Received(key, header, payload))


@pytest.fixture
def bus() -> FakeBus:
    return FakeBus()


@pytest.fixture
def state(route_map: Map) -> LiveState:
    return LiveState(replace(route_map, digest=NO_DIGEST), tolerance=3)


@pytest.fixture
def feed(bus: FakeBus, state: LiveState) -> Feed:
    return Feed(cast(Bus, bus), KEYS, state)


def test_a_match_waits_for_what_it_was_made_of(bus: FakeBus, feed: Feed, state: LiveState) -> None:
    bus.put(KEYS.match, 0, MatchMessage(map=NO_DIGEST, place=1, score=1.0).encode())
    feed.drain()
    assert not state.answers
    bus.put(KEYS.frame, 0, b"a frame")
    feed.drain()
    [answer] = state.answers
    assert state.frame(answer) == b"a frame"


def test_smoothed_matches_are_kept_with_their_answers(
    bus: FakeBus, feed: Feed, state: LiveState
) -> None:
    for sequence in (4, 5):
        smoothed = SmoothedMessage(map=NO_DIGEST, place=sequence, score=1.0, lag=7)
        bus.put(KEYS.smoothed, sequence, smoothed.encode())
        bus.put(KEYS.match, sequence, MatchMessage(map=NO_DIGEST, place=1, score=1.0).encode())
    feed.drain()
    feed.drain()
    later = [state.smoothed(answer) for answer in state.answers]
    assert [smoothed and smoothed.place for smoothed in later] == [4, 5]


def test_garbage_is_counted_and_holds_nothing_up(
    bus: FakeBus, feed: Feed, state: LiveState
) -> None:
    for key in (KEYS.feature, KEYS.all_candidates, KEYS.match):
        bus.put(key, 0, b"garbage")
    bus.receive_raw[KEYS.all_stats](KEYS.stats("fuser", "ab"), b"garbage")
    bus.put(KEYS.match, 1, MatchMessage(map=NO_DIGEST, place=1, score=1.0).encode())
    feed.drain()
    feed.drain()
    assert feed.counts["malformed"] == 4
    assert [answer.header.sequence for answer in state.answers] == [1]


def test_the_status_is_what_the_services_report(bus: FakeBus, feed: Feed) -> None:
    bus.change(KEYS.alive("fuser", "ab"), True)
    bus.change(KEYS.alive("featurizer", "cd"), True)
    bus.change(KEYS.alive("verifier", "ef"), True)
    bus.change(KEYS.alive("verifier", "ef"), False)
    bus.put(KEYS.frame, 20, b"")
    bus.put(KEYS.feature, 9, b"")
    for service, process, sequence in (("fuser", "ab", 7), ("featurizer", "cd", 9)):
        stats = StatsMessage(
            service=service, counts={"gaps": 2}, stream="s", sequence=sequence, channels=1
        )
        bus.receive_raw[KEYS.all_stats](KEYS.stats(service, process), stats.encode())
    status = feed.status()
    featurizer, fuser = status.services
    assert (fuser.behind, fuser.counts) == (2, {"gaps": 2})
    assert featurizer.behind == 11  # frames that were sent
    assert status.missing == ("channel 0",)


def received(sequence: int, size: int = 1) -> Received:
    return Received("key", Header(stream="s", sequence=sequence, stamp_ns=0), bytes(size))


def sequences(newest: Newest) -> list[int]:
    return [message.header.sequence for message in newest.get_batch()]


def test_messages_are_read_once_and_in_order() -> None:
    newest = Newest()
    for sequence in range(3):
        newest.offer(received(sequence))
    assert sequences(newest) == [0, 1, 2]
    assert sequences(newest) == []


def test_the_newest_win_and_what_had_to_go_is_counted() -> None:
    newest = Newest(most=3)
    for sequence in range(10):
        newest.offer(received(sequence))
    assert sequences(newest) == [7, 8, 9]
    assert newest.dropped == 7


def test_large_messages_make_room_for_each_other_but_for_the_last() -> None:
    newest = Newest(most_bytes=100)
    for sequence, size in enumerate((40, 40, 40, 500)):
        newest.offer(received(sequence, size))
    assert sequences(newest) == [3]
    newest.offer(received(4, 40))
    newest.offer(received(5, 40))
    assert sequences(newest) == [4, 5]
