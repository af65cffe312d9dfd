import time
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.bus.history import History, recalling, share
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import HistoryQuery
from placefield.bus.session import Bus, open_bus, open_router
from placefield.config import BusConfig
from placefield.errors import MessageError

KEY = Keys("test").history(Keys("test").feature)


def header(sequence: int, stream: str = "s") -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=0)


def told(history: History, stream: str, first: int, end: int) -> dict[int, bytes]:
    query = HistoryQuery(stream=stream, first=first, end=end).encode()
    replies = history.reply(query)
    return {Header.decode(attachment).sequence: payload for payload, attachment in replies}


@given(
    st.lists(st.tuples(st.sampled_from("ab"), st.integers(0, 9)), max_size=40),
    st.integers(0, 9),
    st.integers(0, 9),
)
def test_the_newest_messages_of_the_last_stream_are_told(
    remembered: list[tuple[str, int]], first: int, end: int
) -> None:
    history = History(4)
    expected: dict[int, bytes] = {}
    last = ""
    for number, (stream, sequence) in enumerate(remembered):
        payload = str(number).encode()
        history.remember(header(sequence, stream), payload)
        if stream != last:
            expected, last = {}, stream
        expected[sequence] = payload
        expected = dict(list(expected.items())[-4:])
        assert history.find(header(sequence, stream)) == payload
    wanted = {s: payload for s, payload in expected.items() if first <= s < end}
    assert told(history, last or "a", first, end) == wanted
    assert told(history, "another", 0, 10) == {}
    assert history.find(header(3, "another")) is None


def test_the_newest_is_what_came_last_also_where_little_is_kept() -> None:
    history = History(2)
    assert history.newest is None
    for newest in (header(7), header(8), header(9), header(0, "next")):
        history.remember(newest, b"")
        assert history.newest == newest


def test_what_is_no_query_is_refused() -> None:
    with pytest.raises(MessageError):
        list(History().reply(b"garbage"))


@pytest.fixture
def router(endpoint: str) -> Iterator[Bus]:
    with open_router(BusConfig(endpoint=endpoint)) as bus:
        yield bus


def test_what_several_remember_is_put_together_in_order(router: Bus, endpoint: str) -> None:
    with (
        open_bus(BusConfig(endpoint=endpoint)) as other,
        open_bus(BusConfig(endpoint=endpoint)) as asker,
    ):
        for bus, sequences in ((router, (2, 3, 4)), (other, (0, 1, 2))):
            history = History()
            for sequence in sequences:
                history.remember(header(sequence), str(sequence).encode())
            share(bus, KEY, history)
        end = time.monotonic() + 10
        while len(recalled := recalling(asker, KEY)("s", 1, 4)) < 3:
            assert time.monotonic() < end, "in vain"
        assert [(s, payload) for s, (_, payload) in recalled.items()] == [
            (1, b"1"),
            (2, b"2"),
            (3, b"3"),
        ]
        assert recalling(asker, KEY)("another", 0, 9) == {}
        assert recalling(asker, "placefield/test/history/nothing")("s", 0, 9) == {}
