"""Times of several ways, by a clock that the ways themselves move on."""

from collections.abc import Callable

import pytest

from placefield_tools.bench.timing import Timings


class Clock:
    """Stands still but for what the ways take."""

    def __init__(self) -> None:
        self.now = 0.0
        self.order: list[str] = []

    def __call__(self) -> float:
        return self.now

    def way(self, name: str, *takes: float) -> Callable[[], None]:
        left = list(takes)

        def run() -> None:
            self.order.append(name)
            self.now += left.pop(0)

        return run


def test_medians_and_ratios_leave_the_warm_up_out() -> None:
    clock = Clock()
    ours = clock.way("ours", 100.0, 1.0, 2.0, 6.0)
    plain = clock.way("plain", 900.0, 4.0, 20.0, 6.0)
    times = Timings.of([plain, ours], rounds=3, clock=clock)
    assert times.median(0) == 6
    assert times.median(1) == 2
    assert times.ratio(0, 1) == pytest.approx(4)  # of 4, 10 and 1


def test_the_ways_take_turns() -> None:
    clock = Clock()
    ways = [clock.way(name, *[1.0] * 3) for name in "ab"]
    Timings.of(ways, rounds=2, clock=clock)
    assert "".join(clock.order) == "ababab"
