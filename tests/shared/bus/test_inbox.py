import threading
import time
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.bus import inbox as inbox_module
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import CAPACITY, Inbox, Received
from placefield.bus.messages import Header


def received(sequence: int, *, live: bool = False, end: bool = False) -> Received:
    header = Header(stream="s", sequence=sequence, stamp_ns=0, live=live, end=end)
    return Received("key", header, b"")


def drain(inbox: Inbox) -> list[int]:
    taken = []
    while (message := inbox.take(0)) is not None:
        taken.append(message.header.sequence)
    return taken


def test_messages_come_out_in_the_order_in_which_they_went_in() -> None:
    inbox = Inbox(Counter())
    for sequence in range(10):
        inbox.offer(received(sequence))
    assert drain(inbox) == list(range(10))


def test_a_live_stream_keeps_the_newest_and_its_end() -> None:
    counts: Counter[str] = Counter()
    inbox = Inbox(counts, live_capacity=2)
    for sequence in range(7):
        inbox.offer(received(sequence, live=True))
    inbox.offer(received(7, live=True, end=True))
    assert drain(inbox) == [5, 6, 7]
    assert counts == {"dropped_old": 5}


def test_a_lossless_stream_keeps_the_oldest_far_above_the_credit_window() -> None:
    assert CAPACITY > 10 * WINDOW
    counts: Counter[str] = Counter()
    inbox = Inbox(counts, live_capacity=2)
    for sequence in range(CAPACITY + 3):
        inbox.offer(received(sequence))
    assert drain(inbox) == list(range(CAPACITY))
    assert counts == {"dropped_full": 3}


def test_live_messages_displace_neither_a_lossless_stream_nor_the_end_of_one() -> None:
    inbox = Inbox(Counter(), live_capacity=2)
    for sequence in range(5):
        inbox.offer(received(sequence))
    inbox.offer(received(5, live=True, end=True))
    for sequence in range(6, 9):
        inbox.offer(received(sequence, live=True))
    assert drain(inbox) == list(range(9))


@given(st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans()), max_size=60))
def test_every_message_is_taken_in_order_or_counted(steps: list[tuple[bool, bool, bool]]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inbox_module, "CAPACITY", 8)
        counts: Counter[str] = Counter()
        inbox = Inbox(counts, live_capacity=3)
        taken = []
        for sequence, (live, end, take) in enumerate(steps):
            inbox.offer(received(sequence, live=live, end=end))
            if take and (message := inbox.take(0)) is not None:
                taken.append(message.header.sequence)
        taken += drain(inbox)
    assert taken == sorted(set(taken))
    assert len(taken) + counts.total() == len(steps)


def test_taking_waits_for_a_message_but_no_longer_than_asked() -> None:
    inbox = Inbox(Counter())
    assert inbox.take(0.01) is None
    timer = threading.Timer(0.05, inbox.offer, [received(3)])
    timer.start()
    began = time.monotonic()
    message = inbox.take(30)
    timer.join()
    assert message == received(3)
    assert time.monotonic() - began < 15
