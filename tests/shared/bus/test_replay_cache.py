import time
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.bus.connecting import open_bus, open_router
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import CacheQuery
from placefield.bus.replay_cache import ReplayCache, fetcher, serve_cache
from placefield.bus.session import Bus
from placefield.config import BusConfig
from placefield.errors import MessageError

KEY = Keys("test").cache(Keys("test").feature)


def header(sequence: int, stream: str = "s") -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=0)


def replies(cache: ReplayCache, stream: str, first: int, end: int) -> dict[int, bytes]:
    query = CacheQuery(stream=stream, first=first, end=end).encode()
    replies = cache.reply(query)
    return {Header.decode(attachment).sequence: payload for payload, attachment in replies}


@given(
    st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 9)), max_size=40),
    st.integers(0, 9),
    st.integers(0, 9),
)
def test_a_cache_replies_with_the_newest_messages_of_the_last_stream(
    remembered: list[tuple[str, int]], first: int, end: int
) -> None:
    cache = ReplayCache(4)
    expected: dict[int, bytes] = {}
    last = ""
    for number, (stream, sequence) in enumerate(remembered):
        payload = str(number).encode()
        cache.store(header(sequence, stream), payload)
        if stream != last:
            expected, last = {}, stream
        expected[sequence] = payload
        expected = dict(list(expected.items())[-4:])
        assert cache.find(header(sequence, stream)) == payload
    wanted = {s: payload for s, payload in expected.items() if first <= s < end}
    assert replies(cache, last or "a", first, end) == wanted
    assert replies(cache, "another", 0, 10) == {}
    assert cache.find(header(3, "another")) is None


def test_the_newest_message_is_the_last_one_in_a_small_cache_too() -> None:
    cache = ReplayCache(2)
    assert cache.newest is None
    for newest in (header(7), header(8), header(9), header(0, "next")):
        cache.store(newest, b"")
        assert cache.newest == newest


def test_a_malformed_query_is_refused() -> None:
    with pytest.raises(MessageError):
        list(ReplayCache().reply(b"garbage"))


@pytest.fixture
def router(endpoint: str) -> Iterator[Bus]:
    with open_router(BusConfig(endpoint=endpoint)) as bus:
        yield bus


def test_messages_of_several_caches_are_merged_in_order(router: Bus, endpoint: str) -> None:
    with (
        open_bus(BusConfig(endpoint=endpoint)) as other,
        open_bus(BusConfig(endpoint=endpoint)) as asker,
    ):
        for bus, sequences in ((router, (2, 3, 4)), (other, (0, 1, 2))):
            cache = ReplayCache()
            for sequence in sequences:
                cache.store(header(sequence), str(sequence).encode())
            serve_cache(bus, KEY, cache)
        end = time.monotonic() + 60
        while len(fetched := fetcher(asker, KEY)("s", 1, 4)) < 3:
            assert time.monotonic() < end, "in vain"
        assert [(s, payload) for s, (_, payload) in fetched.items()] == [
            (1, b"1"),
            (2, b"2"),
            (3, b"3"),
        ]
        assert fetcher(asker, KEY)("another", 0, 9) == {}
        assert fetcher(asker, "placefield/test/cache/nothing")("s", 0, 9) == {}
