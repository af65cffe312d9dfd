"""What the featurizer waits for, and that it never waits for long."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from bus_doubles import header, received
from numpy.typing import NDArray

from placefield.bus.keys import Keys
from placefield.bus.message import Message
from placefield.bus.messages import FeatureMessage, RawFeatureMessage
from placefield.errors import FrameError
from placefield_services import raw_features as raw_features_module
from placefield_services.background_query import NotYet
from placefield_services.live_describers import LiveDescribers
from placefield_services.raw_features import MOST, RawFeatures, RawKind

KEYS = Keys("test")
PATIENCE_S = 0.5


class Clock:
    now = 100.0

    def monotonic(self) -> float:
        return self.now


class Run:
    """Two describers, ``a`` and ``b``, which describe the frames 0, 3, … and 1, 4, …."""

    def __init__(self, clock: Clock, parts: int = 1) -> None:
        self.clock = clock
        self.counts: Counter[str] = Counter()
        self.describers = LiveDescribers()
        self.released: list[str] = []
        for identity in ("a", "b"):
            self.describers.change(KEYS.alive("describer", identity), True)
        self.described: list[Sequence[int]] = []
        """The parts that the featurizer described while it waited for others."""
        kind = RawKind("model", (3,) * parts)
        self.raws = RawFeatures(self.describers, kind, PATIENCE_S, self.counts)

    def leave(self, *sequences: int) -> None:
        for sequence in sequences:
            self.raws.leave(header(sequence))

    def send(self, describer: str, sequence: int, message: Message | None = None) -> None:
        raw = np.full(3, sequence, np.float32)
        message = message or RawFeatureMessage(model="model", raw=raw)
        sent = received(KEYS.raw(describer), header(sequence), message)
        self.raws.receive(sent, self.released.append)

    def send_part(self, describer: str, sequence: int, part: int) -> None:
        raw = np.full(3, 10 * sequence + part, np.float32)
        self.send(describer, sequence, RawFeatureMessage(model="model", part=part, raw=raw))

    def take_parts(self, sequence: int) -> dict[int, float] | str:
        try:
            raws = self.raws.take(header(sequence), self.describe)
        except NotYet:
            return "wait"
        return {part: float(raw[0]) for part, raw in raws.items()}

    def describe(self, parts: Sequence[int]) -> Mapping[int, NDArray[np.float32]]:
        if parts:
            self.described.append(parts)
        return {part: np.full(3, -part, np.float32) for part in parts}

    def take(self, sequence: int) -> float | str | None:
        parts = self.take_parts(sequence)
        return parts.get(0) if isinstance(parts, dict) else parts

    def die(self, describer: str) -> None:
        self.describers.change(KEYS.alive("describer", describer), False)

    def both_are_known(self) -> None:
        self.leave(0, 1)
        self.send("a", 0)
        self.send("b", 1)
        assert (self.take(0), self.take(1)) == (0, 1)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    clock = Clock()
    monkeypatch.setattr(raw_features_module, "time", clock)
    return Run(clock)


def test_a_raw_feature_is_taken_once_whether_it_came_before_its_frame_or_after(run: Run) -> None:
    run.both_are_known()
    run.send("a", 3)
    run.leave(3, 4)
    run.send("b", 4)
    assert (run.take(3), run.take(4), run.take(4)) == (3, 4, None)
    assert not run.counts


@pytest.fixture
def joined(monkeypatch: pytest.MonkeyPatch) -> Run:
    """A run with three parts, of which each describer and the featurizer describe one."""
    clock = Clock()
    monkeypatch.setattr(raw_features_module, "time", clock)
    run = Run(clock, parts=3)
    run.send_part("a", 0, 0)
    run.send_part("b", 0, 1)
    assert run.take_parts(0) == {0: 0, 1: 1}
    run.leave(3)
    return run


def test_while_a_part_is_awaited_the_others_are_described_once(joined: Run) -> None:
    assert [joined.take_parts(3), joined.take_parts(3)] == ["wait", "wait"]
    joined.send_part("b", 3, 1)
    assert joined.take_parts(3) == "wait"
    joined.send_part("a", 3, 0)
    assert joined.take_parts(3) == {0: 30, 1: 31, 2: -2}
    assert joined.described == [[2]]
    assert joined.released == ["test"]
    assert not joined.counts


def test_the_part_of_a_dead_describer_is_described_while_that_of_another_is_awaited(
    joined: Run,
) -> None:
    joined.die("a")
    assert joined.take_parts(3) == "wait"
    joined.send_part("b", 3, 1)
    assert joined.take_parts(3) == {0: 0, 1: 31, 2: -2}
    assert joined.described == [[0, 2]]
    assert joined.counts == {"described_here": 1}


def test_if_a_part_cannot_be_described_no_other_is_awaited(
    joined: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(parts: Sequence[int]) -> Mapping[int, NDArray[np.float32]]:
        raise FrameError("no image")

    monkeypatch.setattr(joined, "describe", fail)
    assert joined.take_parts(3) == {}


def test_a_part_that_the_feature_does_not_have_is_refused(run: Run) -> None:
    run.send_part("a", 0, 1)
    assert run.counts == {"malformed": 1}


def test_the_featurizers_own_turn_is_waited_for_by_nobody(run: Run) -> None:
    run.both_are_known()
    run.leave(2)
    assert run.take(2) is None
    assert not run.counts


def test_a_describer_is_not_waited_for_before_its_first_raw_feature(run: Run) -> None:
    run.leave(0)
    assert run.take(0) is None
    assert run.counts == {"described_here": 1}


def test_an_awaited_frame_is_asked_for_until_it_comes_and_then_its_run_is_released(
    run: Run,
) -> None:
    run.both_are_known()
    run.leave(3, 4)
    assert run.take(3) == "wait"
    run.send("b", 4)
    assert not run.released
    run.send("a", 3)
    assert run.released == ["test"]
    assert (run.take(3), run.take(4)) == (3, 4)
    assert not run.counts


def test_a_silent_describer_costs_one_wait_until_it_is_heard_again(run: Run) -> None:
    run.both_are_known()
    run.leave(3, 6, 9)
    assert run.take(3) == "wait"
    run.clock.now += PATIENCE_S
    assert (run.take(3), run.take(6)) == (None, None)
    assert run.counts == {"described_here": 2}
    run.send("a", 6)
    assert run.take(9) == "wait"
    run.send("a", 9)
    assert run.take(9) == 9


def test_a_slow_describer_is_waited_for_as_long_as_it_goes_on(run: Run) -> None:
    run.both_are_known()
    run.leave(3, 6, 9)
    for sequence in (3, 6, 9):
        run.clock.now += 0.9 * PATIENCE_S
        assert run.take(9 if sequence == 3 else sequence) == "wait"
        run.send("a", sequence)
        assert run.take(sequence) == sequence


def test_a_dead_describer_is_not_waited_for(run: Run) -> None:
    run.both_are_known()
    run.leave(3)
    assert run.take(3) == "wait"
    run.die("a")
    assert run.take(3) is None
    assert run.counts == {"described_here": 1}


def test_a_frame_that_its_describer_passed_over_is_not_waited_for(run: Run) -> None:
    run.both_are_known()
    run.leave(3, 4, 6)
    assert run.take(3) == "wait"
    run.send("a", 6)
    assert run.released == ["test"]
    assert (run.take(3), run.take(4), run.take(6)) == (None, "wait", 6)
    assert run.counts == {"described_here": 1}


@pytest.mark.parametrize(
    ("bad", "counted"),
    [
        (RawFeatureMessage(model="another", raw=np.ones(3, np.float32)), "other_map"),
        (RawFeatureMessage(model="model", raw=np.ones(4, np.float32)), "malformed"),
        (FeatureMessage(model="model", descriptor=np.ones(3, np.float32)), "malformed"),
    ],
)
def test_after_a_bad_raw_feature_its_describer_is_not_waited_for(
    run: Run, bad: Message, counted: str
) -> None:
    run.both_are_known()
    run.leave(3, 4)
    assert run.take(3) == "wait"
    run.send("a", 3, bad)
    assert run.released == ["test"]
    assert (run.take(3), run.take(4)) == (None, "wait")
    assert run.counts == {counted: 1, "described_here": 1}


def test_not_a_number_is_no_raw_feature(run: Run) -> None:
    run.both_are_known()
    run.leave(3)
    bad = np.array([1, np.nan, 1], np.float32)
    run.send("a", 3, RawFeatureMessage.model_construct(version=3, model="model", raw=bad))
    assert run.take(3) is None
    assert run.counts["malformed"] == 1


def test_a_frame_that_its_describer_cannot_read_is_left_to_the_featurizer(run: Run) -> None:
    run.both_are_known()
    run.leave(3, 6)
    run.send("a", 3, RawFeatureMessage(model="model", raw=None))
    assert (run.take(3), run.take(6)) == (None, "wait")


def test_a_second_raw_feature_of_a_frame_changes_nothing(run: Run) -> None:
    run.both_are_known()
    run.leave(3)
    run.send("a", 3)
    run.send("b", 3, RawFeatureMessage(model="model", raw=np.full(3, 99, np.float32)))
    assert run.take(3) == 3


def test_however_many_frames_and_raw_features_come_few_are_kept(run: Run) -> None:
    run.both_are_known()
    run.leave(*range(3, 30 * MOST))
    assert sum(run.raws.is_awaited(header(n)) for n in range(30 * MOST)) <= MOST
    for sequence in range(3, 3 * 2 * MOST, 3):
        run.send("a", sequence)
    assert sum(run.take(n) is not None for n in range(0, 3 * 2 * MOST, 3)) <= MOST
