import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from placefield.fusion.joiner import Joined, Joiner
from placefield.matching.candidate import NO_EVIDENCE, NO_PLACES, Candidate

DEADLINE_S = 2.0


def joiner_of(
    channels: Iterable[int] = (0, 1), *, first: int = 0, gaps_expected: bool = False
) -> tuple[Joiner, Counter[str]]:
    counts: Counter[str] = Counter()
    joiner = Joiner(channels, DEADLINE_S, counts, first=first, gaps_expected=gaps_expected)
    return joiner, counts


def candidate(score: float = 0.0) -> Candidate:
    return Candidate(7, score, NO_PLACES, NO_EVIDENCE)


def sequences(released: list[Joined]) -> list[int]:
    return [joined.sequence for joined in released]


def test_a_frame_is_released_as_soon_as_all_have_answered() -> None:
    joiner, counts = joiner_of()
    joiner.announce(0, now=0)
    first, second = candidate(1.0), candidate(2.0)
    joiner.add(0, 1, second, now=0)
    assert joiner.release(now=0) == []
    assert joiner.pending == 1
    joiner.add(0, 0, first, now=0)
    (joined,) = joiner.release(now=0)
    assert list(joined.candidates.items()) == [(0, first), (1, second)]
    assert joined.missing == frozenset()
    assert joiner.pending == 0
    assert counts["partial"] == 0


def test_a_complete_frame_waits_for_the_one_before_it() -> None:
    joiner, _ = joiner_of((0,))
    for sequence in (0, 1, 2):
        joiner.announce(sequence, now=0)
    joiner.add(2, 0, candidate(), now=0)
    joiner.add(1, 0, candidate(), now=0)
    assert joiner.release(now=1) == []
    joiner.add(0, 0, candidate(), now=1)
    assert sequences(joiner.release(now=1)) == [0, 1, 2]


def test_at_its_deadline_a_frame_goes_with_what_it_has() -> None:
    joiner, counts = joiner_of()
    joiner.announce(0, now=10)
    joiner.add(0, 1, candidate(), now=11.9)
    assert joiner.release(now=11.9) == []
    (joined,) = joiner.release(now=12)
    assert set(joined.candidates) == {1}
    assert joined.missing == {0}
    assert counts["partial"] == 1


def test_a_dead_channel_is_not_awaited_but_its_earlier_candidates_count() -> None:
    joiner, _ = joiner_of()
    joiner.announce(0, now=0)
    joiner.announce(1, now=0)
    joiner.add(0, 1, candidate(), now=0)
    joiner.add(0, 0, candidate(), now=0)
    joiner.add(1, 0, candidate(), now=0)
    joiner.set_alive({0})
    first, second = joiner.release(now=0)
    assert set(first.candidates) == {0, 1}
    assert second.missing == {1}


def test_a_tardy_channel_holds_up_the_stream_once_and_is_awaited_again_when_it_answers() -> None:
    joiner, _ = joiner_of()
    for sequence in range(3):
        joiner.announce(sequence, now=sequence)
        joiner.add(sequence, 0, candidate(), now=sequence)
    assert sequences(joiner.release(now=2)) == [0, 1, 2]

    joiner.add(0, 1, candidate(), now=3)
    joiner.announce(3, now=3)
    joiner.add(3, 0, candidate(), now=3)
    assert joiner.release(now=3) == []
    joiner.add(3, 1, candidate(), now=4)
    (joined,) = joiner.release(now=4)
    assert joined.missing == frozenset()


def test_a_channel_that_is_slow_but_answers_is_waited_for() -> None:
    joiner, counts = joiner_of((0,))
    for sequence in range(8):
        joiner.announce(sequence, now=0)
    for sequence in range(8):
        now = (sequence + 1) * 0.9 * DEADLINE_S
        assert joiner.release(now) == []
        joiner.add(sequence, 0, candidate(), now)
        assert sequences(joiner.release(now)) == [sequence]
    assert counts["partial"] == 0


def test_in_a_live_stream_a_channel_is_not_awaited_for_frames_that_it_dropped() -> None:
    joiner, counts = joiner_of((0,), gaps_expected=True)
    for sequence in range(3):
        joiner.announce(sequence, now=0)
    joiner.add(2, 0, candidate(), now=0.1)
    assert sequences(joiner.release(now=0.1)) == [0, 1, 2]
    assert counts["partial"] == 2


def test_a_frame_that_was_not_announced_is_waited_for() -> None:
    joiner, counts = joiner_of((0,))
    joiner.add(1, 0, candidate(), now=0)
    assert joiner.release(now=1) == []
    joiner.add(0, 0, candidate(), now=1)
    assert sequences(joiner.release(now=1)) == [0, 1]
    joiner.add(3, 0, candidate(), now=1)
    assert joiner.release(now=1000) == []  # its source will send it again
    assert sequences(joiner.release(now=math.inf)) == [3]
    assert counts["late"] == 0


def test_frames_that_were_answered_before_are_not_waited_for() -> None:
    joiner, counts = joiner_of((0,), first=7)
    joiner.add(6, 0, candidate(), now=0)
    joiner.add(7, 0, candidate(), now=0)
    assert sequences(joiner.release(now=0)) == [7]
    assert counts["late"] == 1


def test_where_gaps_are_expected_a_missing_frame_is_not_waited_for() -> None:
    joiner, counts = joiner_of((0,), gaps_expected=True)
    joiner.add(1, 0, candidate(), now=0)
    assert sequences(joiner.release(now=0)) == [1]
    joiner.announce(0, now=0)
    joiner.add(0, 0, candidate(), now=0)
    assert joiner.release(now=9) == []
    assert counts["late"] == 1


def test_duplicate_late_and_unknown_candidates_are_dropped_and_counted() -> None:
    joiner, counts = joiner_of()
    first = candidate(1.0)
    joiner.add(0, 0, first, now=0)
    joiner.add(0, 0, candidate(2.0), now=0)
    joiner.add(0, 2, candidate(), now=0)
    joiner.add(0, 1, candidate(), now=0)
    (joined,) = joiner.release(now=0)
    assert joined.candidates[0] is first
    joiner.add(0, 1, candidate(), now=0)
    assert joiner.release(now=9) == []
    assert counts["duplicate"] == counts["unknown_channel"] == counts["late"] == 1


@dataclass
class Account:
    """The calls to a joiner so far, and the frames that it must therefore release."""

    channels: frozenset[int]
    gaps_expected: bool
    since: dict[int, float] = field(default_factory=dict)
    candidates: dict[int, dict[int, Candidate]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    last: int = -1
    answered: float = 0.0

    def announce(self, sequence: int, now: float) -> None:
        if sequence > self.last:
            self.since.setdefault(sequence, now)

    def add(self, sequence: int, channel: int, given: Candidate, now: float) -> None:
        known = self.candidates.setdefault(sequence, {})
        if channel not in self.channels:
            self.counts["unknown_channel"] += 1
        elif sequence <= self.last:
            self.counts["late"] += 1
        elif channel in known:
            self.counts["duplicate"] += 1
        else:
            self.announce(sequence, now)
            known[channel] = given
            self.answered = now

    def check(self, released: list[Joined], now: float) -> None:
        for joined in released:
            assert joined.sequence > self.last
            self.last = joined.sequence
            del self.since[joined.sequence]
            assert joined.candidates == self.candidates.get(joined.sequence, {})
            assert joined.missing == self.channels - joined.candidates.keys()
            self.counts["partial"] += bool(joined.missing)
        in_turn = self.gaps_expected or min(self.since, default=0) == self.last + 1
        if self.since and in_turn:
            assert now < max(self.since[min(self.since)], self.answered) + DEADLINE_S


frames = st.integers(0, 9)
events = st.lists(
    st.one_of(
        st.tuples(st.just("announce"), frames),
        st.tuples(st.just("add"), st.tuples(frames, st.integers(0, 3))),
        st.tuples(st.just("alive"), st.frozensets(st.integers(0, 3))),
        st.tuples(st.just("wait"), st.floats(0, 1.5)),
        st.tuples(st.just("release"), st.none()),
    ),
    max_size=60,
)


@settings(max_examples=200)
@given(events, st.booleans())
def test_every_frame_announced_in_time_is_released_once_in_order_whatever_happens(
    happening: list[tuple[str, Any]], gaps_expected: bool
) -> None:
    joiner, counts = joiner_of((0, 1, 2), gaps_expected=gaps_expected)
    account = Account(frozenset({0, 1, 2}), gaps_expected)
    now = 0.0
    for number, (event, detail) in enumerate(happening):
        if event == "announce":
            joiner.announce(detail, now)
            account.announce(detail, now)
        elif event == "add":
            sequence, channel = detail
            given = candidate(number)
            joiner.add(sequence, channel, given, now)
            account.add(sequence, channel, given, now)
        elif event == "alive":
            joiner.set_alive(detail)
        elif event == "wait":
            now += detail
        else:
            account.check(joiner.release(now), now)
        assert joiner.pending == len(account.since)
    now = math.inf
    account.check(joiner.release(now), now)
    assert joiner.pending == 0
    assert +counts == +account.counts
