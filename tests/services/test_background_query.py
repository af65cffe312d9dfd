"""Background queries: only the run that asks waits for the answer."""

import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest

from placefield_services.background_query import BackgroundQuery, NotYet


class Others:
    """Answer when released, with the number of questions received."""

    def __init__(self) -> None:
        self.answering = threading.Event()
        self.asked: list[tuple[str, int]] = []

    def ask(self, stream: str, first: int) -> int:
        self.asked.append((stream, first))
        assert self.answering.wait(60)
        return len(self.asked)


@pytest.fixture
def others() -> Iterator[Others]:
    others = Others()
    yield others
    others.answering.set()


def answer_of(background_query: BackgroundQuery[[int], int], stream: str, first: int) -> int:
    while True:
        with suppress(NotYet):
            return background_query(stream, first)


def test_a_pending_query_blocks_nothing_and_is_asked_once(others: Others) -> None:
    background_query = BackgroundQuery(others.ask)
    for _ in range(10):
        with pytest.raises(NotYet):
            background_query("stream", 3)
    assert others.asked == [("stream", 3)]
    others.answering.set()
    assert answer_of(background_query, "stream", 3) == 1


def test_each_answer_is_given_once(others: Others) -> None:
    background_query = BackgroundQuery(others.ask)
    others.answering.set()
    assert [answer_of(background_query, "stream", 3) for _ in range(3)] == [1, 2, 3]


def test_an_answer_serves_a_newer_question_of_its_stream_and_none_of_another(
    others: Others,
) -> None:
    background_query = BackgroundQuery(others.ask)
    with pytest.raises(NotYet):
        background_query("stream", 3)
    with pytest.raises(NotYet):
        background_query("stream", 4)
    others.answering.set()
    assert answer_of(background_query, "stream", 5) == 1
    others.answering.clear()
    with pytest.raises(NotYet):
        background_query("stream", 6)
    with pytest.raises(NotYet):
        background_query("other", 7)
    others.answering.set()
    assert answer_of(background_query, "other", 7) == 3
    assert others.asked == [("stream", 3), ("stream", 6), ("other", 7)]


def test_an_error_of_a_query_is_raised_where_its_answer_is_awaited() -> None:
    def ask(stream: str, first: int) -> int:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        answer_of(BackgroundQuery(ask), "stream", 3)
