import os
import threading
import time

import pytest

from placefield_tools.common.parallel import cores, map_in_order


def test_results_come_in_the_order_of_the_items_whichever_is_done_first() -> None:
    def slow_where_even(number: int) -> int:
        time.sleep(0.002 * (number % 2 == 0))
        return number

    assert list(map_in_order(slow_where_even, range(50))) == list(range(50))


def test_items_are_taken_only_a_few_ahead() -> None:
    source = iter(range(10_000))
    next(map_in_order(lambda number: number, source))
    assert next(source) < 1000


def test_an_error_comes_in_its_turn() -> None:
    def third_fails(number: int) -> int:
        if number == 3:
            raise ZeroDivisionError
        return number

    results = map_in_order(third_fails, range(10))
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ZeroDivisionError):
        next(results)


def test_who_stops_early_does_not_wait_for_the_items_at_work() -> None:
    released = threading.Event()

    def first_is_quick(number: int) -> int:
        if number:
            released.wait(60)
        return number

    results = map_in_order(first_is_quick, range(10))
    assert next(results) == 0
    start = time.monotonic()
    results.close()  # type: ignore[attr-defined]
    waited = time.monotonic() - start
    released.set()
    assert waited < 30


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="no affinity on this system")
def test_cores_are_those_that_the_process_may_use() -> None:
    allowed = os.sched_getaffinity(0)
    assert cores() == len(allowed)
    try:
        os.sched_setaffinity(0, {min(allowed)})
        assert cores() == 1
    finally:
        os.sched_setaffinity(0, allowed)
