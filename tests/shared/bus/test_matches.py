from collections.abc import Iterator

import pytest
from bus_readers import await_reader

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage, StatsMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.errors import MessageError, OtherMapError
from placefield.maps.digest import NO_DIGEST
from placefield_tools.listen.match_queue import MatchQueue, stream_matches

KEYS = Keys("test")


def header(sequence: int, *, end: bool = False) -> Header:
    return Header(stream="s", sequence=sequence, stamp_ns=0, end=end)


@pytest.fixture
def buses(endpoint: str) -> Iterator[tuple[Bus, Bus]]:
    config = BusConfig(endpoint=endpoint)
    with open_router(config) as one, open_bus(config) as other:
        yield one, other


def test_matches_come_in_order_up_to_the_end_of_the_stream(buses: tuple[Bus, Bus]) -> None:
    fuser, listener = buses
    matches = MatchQueue(listener, KEYS)
    await_reader(listener, fuser, KEYS)
    publisher = fuser.publisher(KEYS.match)
    sent = [MatchMessage(map=NO_DIGEST, place=7 * s, score=s / 3, missing=(s,)) for s in range(20)]
    for sequence, match in enumerate(sent):
        publisher.put(header(sequence), match)
    publisher.put(header(20, end=True))
    publisher.put(header(0), sent[0])
    assert list(stream_matches(matches, 60)) == [(header(s), m) for s, m in enumerate(sent)]


def test_stream_matches_ends_when_none_comes(buses: tuple[Bus, Bus]) -> None:
    assert list(stream_matches(MatchQueue(buses[1], KEYS), 0.05)) == []


def test_a_malformed_match_is_refused_and_the_next_one_still_comes(buses: tuple[Bus, Bus]) -> None:
    fuser, listener = buses
    matches = MatchQueue(listener, KEYS)
    await_reader(listener, fuser, KEYS)
    publisher = fuser.publisher(KEYS.match)
    publisher.put(header(0), StatsMessage(service="fuser", counts={}))
    publisher.put(header(1), MatchMessage(map=NO_DIGEST, place=3, score=1.0))
    with pytest.raises(MessageError):
        matches.get(60)
    assert matches.get(60) == (header(1), MatchMessage(map=NO_DIGEST, place=3, score=1.0))


def test_smoothed_matches_come_in_order_too_and_the_end_behind_them(buses: tuple[Bus, Bus]) -> None:
    fuser, listener = buses
    both = MatchQueue(listener, KEYS, smoothed=True)
    await_reader(listener, fuser, KEYS)
    matches, smoothed = fuser.publisher(KEYS.match), fuser.publisher(KEYS.smoothed)
    at_once = [MatchMessage(map=NO_DIGEST, place=s, score=0.0) for s in range(5)]
    later = [SmoothedMessage(map=NO_DIGEST, place=s + 1, score=0.0, lag=3) for s in range(5)]
    for sequence in range(5):
        matches.put(header(sequence), at_once[sequence])
    matches.put(header(5, end=True))
    for sequence in (0, 1, 0, 2, 3, 4):  # one is published a second time, by a new fuser
        smoothed.put(header(sequence), later[sequence])
    smoothed.put(header(5, end=True))
    received = list(stream_matches(both, 60))
    kinds = [
        [t for t in received if isinstance(t[1], SmoothedMessage) == is_one] for is_one in (0, 1)
    ]
    assert kinds[0] == [(header(s), one) for s, one in enumerate(at_once)]
    assert kinds[1] == [(header(s), one) for s, one in enumerate(later)]


def test_matches_of_another_map_than_the_given_one_are_refused(buses: tuple[Bus, Bus]) -> None:
    fuser, listener = buses
    both = MatchQueue(listener, KEYS, smoothed=True, digests={"a" * 16})
    await_reader(listener, fuser, KEYS)
    matches, smoothed = fuser.publisher(KEYS.match), fuser.publisher(KEYS.smoothed)
    own, other = {"map": "a" * 16, "score": 0.0}, {"map": "b" * 16, "score": 0.0}
    matches.put(header(0), MatchMessage(place=1, **own))
    assert both.get(60) == (header(0), MatchMessage(place=1, **own))
    matches.put(header(1), MatchMessage(place=2, **other))
    with pytest.raises(OtherMapError):
        both.get(60)
    smoothed.put(header(0), SmoothedMessage(place=1, lag=2, **other))
    with pytest.raises(OtherMapError):
        both.get(60)
    matches.put(header(2), MatchMessage(place=3, **own))
    assert both.get(60) == (header(2), MatchMessage(place=3, **own))
    assert both.counts["gaps"] == 1


def test_a_stream_may_go_over_to_a_new_version_of_the_map(buses: tuple[Bus, Bus]) -> None:
    fuser, listener = buses
    queue = MatchQueue(listener, KEYS)
    await_reader(listener, fuser, KEYS)
    matches = fuser.publisher(KEYS.match)
    for sequence, digest in enumerate(("a" * 16, "b" * 16)):
        match = MatchMessage(map=digest, place=1, score=0.0)
        matches.put(header(sequence), match)
        assert queue.get(60) == (header(sequence), match)
