import time

import numpy as np
import pytest

from placefield.features.frames import Frame
from placefield_tools.parallel import map_in_order

PIXELS = np.zeros((1, 1), np.uint8)


def frames(count: int) -> list[Frame]:
    return [Frame(index, 0, f"frame {index}", PIXELS) for index in range(count)]


def test_results_come_in_the_order_of_the_frames_whichever_is_done_first() -> None:
    def slow_where_even(frame: Frame) -> int:
        time.sleep(0.002 * (frame.index % 2 == 0))
        return frame.index

    assert list(map_in_order(slow_where_even, frames(50))) == list(range(50))


def test_frames_are_taken_only_a_few_ahead() -> None:
    source = iter(frames(10_000))
    next(map_in_order(lambda frame: frame.index, source))
    assert next(source).index < 1000


def test_an_error_comes_in_its_turn() -> None:
    def third_fails(frame: Frame) -> int:
        if frame.index == 3:
            raise ZeroDivisionError
        return frame.index

    results = map_in_order(third_fails, frames(10))
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ZeroDivisionError):
        next(results)
