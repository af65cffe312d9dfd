from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.bus.message import Header
from placefield.bus.streams import Arrival, StreamFollower, StreamSwitch, Turn
from placefield.errors import MessageError


def header(stream: str, sequence: int) -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=0)


def test_a_stream_that_was_left_is_never_entered_again() -> None:
    counts: Counter[str] = Counter()
    switch = StreamSwitch(counts)
    streams = ("a", "a", "b", "a", "b", "c", "a", "b")
    arrivals = [switch.enter(header(stream, 0)) for stream in streams]
    new, same, dropped = Arrival.NEW_STREAM, Arrival.SAME_STREAM, Arrival.DROPPED
    assert arrivals == [new, same, new, dropped, same, new, dropped, dropped]
    assert counts == {"streams": 3, "stale": 3}


def follower_from_first(counts: Counter[str]) -> StreamFollower:
    return StreamFollower(counts, lambda first: first.sequence)


@given(st.lists(st.integers(0, 12), min_size=1, max_size=40), st.booleans())
def test_each_frame_is_followed_once_in_order_and_every_skipped_frame_is_counted(
    sequences: list[int], skips: bool
) -> None:
    counts: Counter[str] = Counter()
    follower = follower_from_first(counts)
    followed, out_of_order = [], 0
    for sequence in sequences:
        turn = follower.follow(header("s", sequence))
        if turn is Turn.AFTER_GAP and skips:
            follower.skip_to(sequence)
        if turn is Turn.NEXT or (turn is Turn.AFTER_GAP and skips):
            followed.append(sequence)
        out_of_order += turn is Turn.AFTER_GAP and not skips
    assert followed[0] == sequences[0]
    assert followed == sorted(set(followed))
    assert counts["gaps"] == followed[-1] - followed[0] + 1 - len(followed)
    assert counts["gaps"] == 0 or skips
    assert counts["repeated"] == len(sequences) - len(followed) - out_of_order


def test_joining_a_stream_late_is_no_gap() -> None:
    counts: Counter[str] = Counter()
    follower = follower_from_first(counts)
    assert follower.follow(header("a", 0)) is Turn.NEXT
    assert follower.follow(header("b", 500)) is Turn.NEXT
    assert counts["gaps"] == 0
    assert follower.follow(header("b", 503)) is Turn.AFTER_GAP
    follower.skip_to(503, 1)
    assert counts["gaps"] == 1
    assert follower.next == 504


def test_join_decides_where_a_stream_begins() -> None:
    joined: list[int] = []

    def join(first: Header) -> int:
        joined.append(first.sequence)
        return 7

    follower = StreamFollower(Counter(), join)
    turns = [follower.follow(header("a", sequence)) for sequence in (9, 6, 7, 8, 9)]
    assert turns == [Turn.AFTER_GAP, Turn.REPEATED, Turn.NEXT, Turn.NEXT, Turn.NEXT]
    assert joined == [9]


def test_a_message_that_is_dropped_leaves_the_stream_as_it_was() -> None:
    counts: Counter[str] = Counter()
    follower = follower_from_first(counts)
    for arrived in (header("a", 0), header("b", 0), header("b", 1)):
        follower.follow(arrived)
    assert follower.follow(header("a", 1)) is Turn.DROPPED
    for late in (header("b", 0), header("b", 1)):
        assert follower.follow(late) is Turn.REPEATED
    assert follower.follow(header("b", 2)) is Turn.NEXT
    assert counts["gaps"] == 0


@pytest.mark.parametrize("live", [True, False])
def test_a_live_frame_in_a_lossless_stream_or_the_reverse_is_refused_and_the_stream_continues(
    live: bool,
) -> None:
    counts: Counter[str] = Counter()
    follower = follower_from_first(counts)
    ours = [header("s", n).model_copy(update={"live": live}) for n in range(3)]
    assert follower.follow(ours[0]) is Turn.NEXT
    for sequence in (0, 1, 2**40):
        with pytest.raises(MessageError, match="live and its stream is not"):
            follower.follow(header("s", sequence).model_copy(update={"live": not live}))
    assert [follower.follow(one) for one in ours[1:]] == [Turn.NEXT, Turn.NEXT]
    assert counts == {"streams": 1}
