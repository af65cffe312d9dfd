import threading
import time
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.bus import inbox as inbox_module
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import CAPACITY, Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header

KEY = Keys("test").frame


def received(sequence: int, *, live: bool = False, end: bool = False, key: str = KEY) -> Received:
    header = Header(stream="s", sequence=sequence, stamp_ns=0, live=live, end=end)
    return Received(key, header, b"")


def inbox_of(*runs: str, live_capacity: int = CAPACITY) -> tuple[Inbox, dict[str, Counter[str]]]:
    counts: dict[str, Counter[str]] = {run: Counter() for run in runs or ("test",)}
    return Inbox(counts, live_capacity=live_capacity), counts


def drain(inbox: Inbox, limit: int = CAPACITY) -> list[int]:
    sequences = []
    while messages := inbox.get_batch(0, limit):
        assert len(messages) <= limit
        sequences += [message.header.sequence for message in messages]
    return sequences


@pytest.mark.parametrize("limit", [1, 3, 100])
def test_messages_come_out_in_the_order_in_which_they_went_in(limit: int) -> None:
    inbox, _ = inbox_of()
    for sequence in range(10):
        inbox.offer(received(sequence))
    assert drain(inbox, limit) == list(range(10))


def test_waiting_messages_come_in_one_batch_up_to_the_limit() -> None:
    inbox, _ = inbox_of()
    for sequence in range(10):
        inbox.offer(received(sequence))
    assert [len(inbox.get_batch(0, 4)) for _ in range(4)] == [4, 4, 2, 0]


def test_a_live_stream_keeps_the_newest_and_its_end() -> None:
    inbox, counts = inbox_of(live_capacity=2)
    for sequence in range(7):
        inbox.offer(received(sequence, live=True))
    inbox.offer(received(7, live=True, end=True))
    assert drain(inbox) == [5, 6, 7]
    assert counts == {"test": {"dropped_old": 5}}


def test_live_messages_that_are_awaited_are_kept_besides_the_newest() -> None:
    awaited, counts = {1, 4}, {"test": Counter[str]()}
    inbox = Inbox(counts, live_capacity=2, keeps=lambda one: one.header.sequence in awaited)
    for sequence in range(7):
        inbox.offer(received(sequence, live=True))
    assert counts == {"test": {"dropped_old": 3}}
    awaited.clear()
    inbox.offer(received(7, live=True))
    assert drain(inbox) == [6, 7]


@pytest.mark.parametrize("is_early", [True, False])
def test_a_released_run_is_served_at_once_even_if_it_is_released_before_it_waits(
    is_early: bool,
) -> None:
    inbox, _ = inbox_of()
    inbox.offer(received(0))
    got = inbox.get_batch(0, 1)
    if is_early:
        inbox.release("test")
    inbox.put_back(got, 60.0)
    if not is_early:
        assert not inbox.is_waiting
        inbox.release("test")
    assert inbox.get_batch(0, 1) == got
    inbox.put_back(got, 60.0)
    assert not inbox.is_waiting


def test_each_run_keeps_its_newest_however_many_another_sends() -> None:
    inbox, counts = inbox_of("calm", "flood", live_capacity=2)
    calm, flood = Keys("calm").frame, Keys("flood").frame
    for sequence in range(100):
        if sequence in (10, 50):
            inbox.offer(received(sequence, live=True, key=calm))
        inbox.offer(received(sequence, live=True, key=flood))
    messages = [(message.run, message.header.sequence) for message in inbox.get_batch(0, 100)]
    assert messages == [("calm", 10), ("flood", 98), ("calm", 50), ("flood", 99)]
    assert counts == {"calm": {}, "flood": {"dropped_old": 98}}


def test_a_camera_is_served_in_turn_with_a_replay_that_never_pauses() -> None:
    inbox, counts = inbox_of("replay", "camera", live_capacity=2)
    served: Counter[str] = Counter()
    for sequence in range(200):
        while len(inbox._waiting["replay"]) < WINDOW:
            inbox.offer(received(sequence, key=Keys("replay").frame))
        inbox.offer(received(sequence, live=True, key=Keys("camera").frame))
        served.update(message.run for message in inbox.get_batch(0, 1))
    assert served == {"replay": 100, "camera": 100}
    assert counts["camera"]["dropped_old"] == 99


def test_a_run_that_is_full_leaves_room_for_another() -> None:
    inbox, counts = inbox_of("calm", "flood")
    for sequence in range(CAPACITY + 5):
        inbox.offer(received(sequence, key=Keys("flood").frame))
    inbox.offer(received(0, key=Keys("calm").frame))
    assert len(inbox.get_batch(0, 2 * CAPACITY)) == CAPACITY + 1
    assert counts == {"calm": {}, "flood": {"dropped_full": 5}}
    inbox.offer(received(0, key=Keys("flood").frame))
    assert len(drain(inbox)) == 1


def test_a_lossless_stream_keeps_the_oldest_far_above_the_credit_window() -> None:
    assert CAPACITY > (1 + 64) * WINDOW  # the frame, and as many channels as a map may have
    inbox, counts = inbox_of(live_capacity=2)
    for sequence in range(CAPACITY + 3):
        inbox.offer(received(sequence))
    assert drain(inbox) == list(range(CAPACITY))
    assert counts == {"test": {"dropped_full": 3}}


def test_live_messages_displace_neither_a_lossless_stream_nor_the_end_of_one() -> None:
    inbox, _ = inbox_of(live_capacity=2)
    for sequence in range(5):
        inbox.offer(received(sequence))
    inbox.offer(received(5, live=True, end=True))
    for sequence in range(6, 9):
        inbox.offer(received(sequence, live=True))
    assert drain(inbox) == [*range(6), 7, 8]


steps = st.tuples(st.booleans(), st.booleans(), st.integers(0, 3), st.sampled_from(["one", "two"]))


@given(st.lists(steps, max_size=60))
def test_every_message_is_returned_in_order_or_counted(
    happening: list[tuple[bool, bool, int, str]],
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inbox_module, "CAPACITY", 8)
        inbox, counts = inbox_of("one", "two", live_capacity=3)
        offered: Counter[str] = Counter()
        messages = []
        for sequence, (live, end, take, run) in enumerate(happening):
            inbox.offer(received(sequence, live=live, end=end, key=Keys(run).frame))
            offered[run] += 1
            messages += inbox.get_batch(0, take) if take else []
        messages += inbox.get_batch(0, 100)
    for run, own in counts.items():
        sequences = [message.header.sequence for message in messages if message.run == run]
        assert sequences == sorted(set(sequences))
        assert len(sequences) + own.total() == offered[run]


def test_get_batch_waits_for_a_message_until_the_timeout() -> None:
    inbox, _ = inbox_of()
    assert inbox.get_batch(0.01, 5) == []
    timer = threading.Timer(0.05, inbox.offer, [received(3)])
    timer.start()
    began = time.monotonic()
    messages = inbox.get_batch(30, 5)
    timer.join()
    assert messages == [received(3)]
    assert time.monotonic() - began < 15
