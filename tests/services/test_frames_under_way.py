import time

import pytest

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield_services.background_query import NotYet
from placefield_services.frames_under_way import FramesUnderWay

ACK = Keys("day").ack


def header(sequence: int, stream: str = "s", *, live: bool = True, end: bool = False) -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=0, live=live, end=end)


class Run:
    """The frames under way of a run, one of so many."""

    def __init__(self, runs: int, patience_s: float = 60.0) -> None:
        self.released = 0
        self.frames = FramesUnderWay(runs, patience_s, self._release)

    def _release(self) -> None:
        self.released += 1

    def passes(self, of: Header) -> bool:
        try:
            self.frames.check(of)
        except NotYet:
            return False
        self.frames.add(of)
        return True

    def answer(self, of: Header) -> None:
        self.frames.receive(Received(ACK, of, b""))


@pytest.mark.parametrize(("runs", "most"), [(1, 8), (3, 2), (8, 1), (40, 1)])
def test_a_run_has_its_share_of_frames_under_way_and_one_at_least(runs: int, most: int) -> None:
    run = Run(runs)
    assert [run.passes(header(number)) for number in range(most + 1)] == [True] * most + [False]


def test_an_answer_lets_the_next_frame_pass_and_stands_for_those_before_it() -> None:
    run = Run(1)
    for number in range(8):
        assert run.passes(header(number))
    run.answer(header(5))
    assert run.released == 1
    passed = [run.passes(header(number)) for number in range(20, 28)]
    assert passed == [True] * 6 + [False] * 2
    run.answer(header(5, "another stream"))
    assert run.released == 1


def test_a_frame_that_was_not_described_holds_no_other() -> None:
    run = Run(100)
    assert run.passes(header(3))
    run.frames.discard(header(3, "another stream"))
    assert not run.passes(header(4))
    run.frames.discard(header(3))
    assert run.passes(header(4))


def test_what_is_no_live_frame_passes_always() -> None:
    run = Run(100)
    assert run.passes(header(0))
    assert not run.passes(header(1))
    assert run.passes(header(2, end=True))
    lossless = Run(100)
    assert all(lossless.passes(header(number, live=False)) for number in range(50))


def test_a_new_stream_begins_without_the_frames_of_the_one_before() -> None:
    run = Run(100)
    assert run.passes(header(7))
    assert run.passes(header(0, "next"))
    assert not run.passes(header(1, "next"))


def test_an_answer_that_is_lost_is_waited_for_so_long_and_no_longer() -> None:
    run = Run(100, patience_s=0.05)
    assert run.passes(header(0))
    with pytest.raises(NotYet) as waits:
        run.frames.check(header(1))
    assert 0 < waits.value.wait_s <= 0.05
    time.sleep(waits.value.wait_s)
    assert run.passes(header(1))
