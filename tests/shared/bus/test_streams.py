from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from placefield.bus.messages import Header
from placefield.bus.streams import Arrival, StreamFollower, StreamSwitch


def header(stream: str, sequence: int) -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=0)


def test_a_stream_that_was_left_is_never_entered_again() -> None:
    counts: Counter[str] = Counter()
    switch = StreamSwitch(counts)
    arrivals = [switch.enter(stream) for stream in ("a", "a", "b", "a", "b", "c", "a", "b")]
    new, same, dropped = Arrival.NEW_STREAM, Arrival.SAME_STREAM, Arrival.DROPPED
    assert arrivals == [new, same, new, dropped, same, new, dropped, dropped]
    assert counts == {"streams": 3, "stale": 3}


@given(st.lists(st.integers(0, 12), min_size=1, max_size=40))
def test_each_frame_is_followed_once_in_order_and_every_one_that_did_not_come_is_counted(
    sequences: list[int],
) -> None:
    counts: Counter[str] = Counter()
    follower = StreamFollower(counts)
    followed = []
    for sequence in sequences:
        if follower.follow(header("s", sequence)) is not Arrival.DROPPED:
            followed.append(sequence)
    assert followed[0] == sequences[0]
    assert followed == sorted(set(followed))
    assert followed[-1] == max(sequences)
    assert counts["gaps"] == followed[-1] - followed[0] + 1 - len(followed)
    assert counts["duplicate"] == len(sequences) - len(followed)


def test_joining_a_stream_late_is_no_gap() -> None:
    counts: Counter[str] = Counter()
    follower = StreamFollower(counts)
    assert follower.follow(header("a", 0)) is Arrival.NEW_STREAM
    assert follower.follow(header("b", 500)) is Arrival.NEW_STREAM
    assert counts["gaps"] == 0
    assert follower.follow(header("b", 503)) is Arrival.SAME_STREAM
    assert counts["gaps"] == 2


def test_a_message_that_is_dropped_leaves_the_stream_as_it_was() -> None:
    counts: Counter[str] = Counter()
    follower = StreamFollower(counts)
    for arrived in (header("a", 0), header("b", 0), header("b", 1)):
        follower.follow(arrived)
    for late in (header("a", 1), header("b", 0), header("b", 1)):
        assert follower.follow(late) is Arrival.DROPPED
    assert follower.follow(header("b", 2)) is Arrival.SAME_STREAM
    assert counts["gaps"] == 0
