"""Times of several ways, by a clock that the ways themselves move on."""

from collections.abc import Callable, Iterable
from itertools import cycle

import pytest

from placefield_tools.bench.timing import Timings, repeat


class Clock:
    """Stands still but for what the ways take."""

    def __init__(self) -> None:
        self.now = 0.0
        self.order: list[str] = []

    def __call__(self) -> float:
        return self.now

    def way(self, name: str, takes: Iterable[float]) -> Callable[[], None]:
        left = iter(takes)

        def run() -> None:
            self.order.append(name)
            self.now += next(left)

        return run


def test_medians_and_ratios_leave_the_warm_up_out() -> None:
    clock = Clock()
    plain = clock.way("plain", [900.0, 4.0, 20.0, 6.0])
    ours = clock.way("ours", [100.0, 1.0, 2.0, 6.0])
    times = Timings.of([plain, ours], limit_s=39, clock=clock)
    assert times.seconds.tolist() == [[4, 1], [20, 2], [6, 6]]
    assert times.median(0) == 6
    assert times.median(1) == 2
    assert times.ratio(0, 1).value == 4  # of 4, 10 and 1


def test_the_ways_take_turns() -> None:
    clock = Clock()
    ways = [clock.way(name, cycle([1.0])) for name in "ab"]
    Timings.of(ways, clock=clock)
    assert "".join(clock.order) == "ab" * (1 + 6)


def test_rounds_are_repeated_until_every_ratio_that_is_asked_for_has_a_narrow_interval() -> None:
    def rounds_of(compared: list[tuple[int, int]]) -> int:
        clock = Clock()
        steady, noisy = cycle([2.0]), cycle([0.5, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
        ways = [clock.way("", cycle([1.0])), clock.way("", steady), clock.way("", noisy)]
        return len(Timings.of(ways, compared=compared, limit_s=1e6, clock=clock).seconds)

    assert rounds_of([]) == rounds_of([(0, 1)]) == 6
    both = rounds_of([(0, 1), (2, 0)])
    assert 6 < both < 40
    assert both == rounds_of([(2, 0)])


def test_no_round_begins_after_the_limit_and_the_ratio_is_not_narrow() -> None:
    clock = Clock()
    ways = [clock.way("", cycle([1.0])), clock.way("", cycle([1.0, 3.0]))]
    times = Timings.of(ways, compared=[(1, 0)], limit_s=60, clock=clock)
    assert len(times.seconds) == 20  # of 3 s on average
    ratio = times.ratio(1, 0)
    assert (ratio.low, ratio.high) == (1, 3)
    assert not ratio.is_narrow


def test_one_round_is_measured_however_long_it_takes() -> None:
    clock = Clock()

    def measure() -> list[float]:
        clock.now += 500
        return [1.0, 2.0]

    assert repeat(measure, [(0, 1)], limit_s=60, clock=clock).tolist() == [[1, 2]]
    assert clock.now == pytest.approx(500)
