import threading

from hypothesis import given
from hypothesis import strategies as st

from placefield.bus.credits import Credits


@given(st.integers(1, 5), st.lists(st.none() | st.integers(0, 30), max_size=60))
def test_never_more_frames_are_under_way_than_the_window(
    window: int, steps: list[int | None]
) -> None:
    """None acquires a credit; a number answers all sent frames up to that number."""
    credits = Credits(window)
    sent = answered = 0
    for step in steps:
        if step is None:
            granted = credits.acquire(0)
            assert granted == (sent - answered < window)
            sent += granted
        elif step < sent:
            credits.answer(step)
            answered = max(answered, step + 1)
        assert credits.answered == answered


def test_an_answer_wakes_a_waiting_acquire() -> None:
    credits = Credits(1)
    assert credits.acquire(0)
    timer = threading.Timer(0.05, credits.answer, [0])
    timer.start()
    assert credits.acquire(30)
    timer.join()


def test_waiting_for_an_answer_ends_with_it_or_with_the_time() -> None:
    credits = Credits()
    assert credits.acquire(0)
    assert not credits.wait_until_answered(0, 0.01)
    timer = threading.Timer(0.05, credits.answer, [0])
    timer.start()
    assert credits.wait_until_answered(0, 30)
    timer.join()
    assert not credits.wait_until_answered(1, 0)
