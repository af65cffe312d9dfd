"""Which messages of a service travel together, with a clock and links of their own."""

import pytest

from placefield.bus import publishing
from placefield.bus.bundle import MOST_TOGETHER, unpack_all
from placefield.bus.message import Header
from placefield.bus.publishing import (
    TOGETHER_S,
    GatheringPublisher,
    NewestPublisher,
    Outbox,
    Publisher,
)


class Link:
    """What a process sends: the name of each publisher and its payloads, sample by sample."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, list[int]]] = []

    def on(self, name: str) -> "OneKey":
        return OneKey(self, name)


class OneKey:
    """Stands for a publisher of Zenoh."""

    def __init__(self, link: Link, name: str) -> None:
        self._link, self._name = link, name

    def put(self, payload: bytes, *, attachment: bytes) -> None:
        sequences = [header.sequence for header, _ in unpack_all(attachment, payload)]
        self._link.sent.append((self._name, sequences))


class Clock:
    """A clock that stands still until it is set."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(publishing, "time", clock)
    return clock


@pytest.fixture
def outbox(clock: Clock) -> Outbox:
    outbox = Outbox()
    outbox.begin()
    return outbox


def put(publisher: Publisher, *sequences: int, live: bool = False) -> None:
    for sequence in sequences:
        publisher.send(Header(stream="s", sequence=sequence, stamp_ns=0, live=live), b"payload")


def test_messages_wait_until_the_service_has_nothing_more_to_do(outbox: Outbox) -> None:
    link = Link()
    features = GatheringPublisher(link.on("features"), outbox)
    put(features, 0, 1, 2)
    assert link.sent == []
    outbox.send_all()
    assert link.sent == [("features", [0, 1, 2])]
    outbox.send_all()
    assert len(link.sent) == 1


def test_messages_wait_no_longer_than_documented(outbox: Outbox, clock: Clock) -> None:
    link = Link()
    features = GatheringPublisher(link.on("features"), outbox)
    put(features, 0, 1)
    clock.now += TOGETHER_S
    outbox.begin()  # it is gathering already
    put(features, 2)
    assert link.sent == [("features", [0, 1, 2])]
    put(features, 3, 4)
    assert len(link.sent) == 1
    clock.now += TOGETHER_S
    assert outbox.is_due


def test_a_message_that_took_long_to_make_is_sent_at_once(outbox: Outbox, clock: Clock) -> None:
    link = Link()
    features = GatheringPublisher(link.on("features"), outbox)
    for sequence in range(3):
        clock.now += TOGETHER_S
        put(features, sequence)
    assert link.sent == [("features", [0]), ("features", [1]), ("features", [2])]


def test_a_wait_for_messages_does_not_count(outbox: Outbox, clock: Clock) -> None:
    link = Link()
    clock.now += 10.0
    outbox.begin()
    put(GatheringPublisher(link.on("features"), outbox), 0)
    assert link.sent == []


def test_live_messages_are_sent_at_once(outbox: Outbox) -> None:
    link = Link()
    moments = NewestPublisher(link.on("moments"), outbox)
    features = GatheringPublisher(link.on("features"), outbox)
    for sequence in range(2):
        put(moments, sequence, live=True)
        put(features, sequence, live=True)
    first, second = [("moments", [0]), ("features", [0])], [("moments", [1]), ("features", [1])]
    assert link.sent == [*first, *second]


def test_no_more_messages_travel_together_than_documented(outbox: Outbox) -> None:
    link = Link()
    put(GatheringPublisher(link.on("features"), outbox), *range(MOST_TOGETHER + 1))
    assert link.sent == [("features", list(range(MOST_TOGETHER)))]


def test_the_newest_message_stands_for_all_and_is_sent_before_what_follows_it(
    outbox: Outbox, clock: Clock
) -> None:
    link = Link()
    moments = NewestPublisher(link.on("moments"), outbox)
    features = GatheringPublisher(link.on("features"), outbox)
    for sequence in range(3):
        put(moments, sequence)
        put(features, sequence)
    clock.now += TOGETHER_S
    put(moments, 3)
    assert link.sent == []  # else moments of a frame that follows would travel with these
    put(features, 3)
    assert link.sent == [("moments", [3]), ("features", [0, 1, 2, 3])]
