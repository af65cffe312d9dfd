"""Queries in the background: all runs share one loop, which must not wait for an answer."""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

_AT_ONCE_S = 0.02  # most answers come within this time
_AGAIN_S = 0.02

Question = ParamSpec("Question")
Answer = TypeVar("Answer")


class NotYet(Exception):  # noqa: N818  # not an error
    """A message cannot be handled yet: it must wait, and so must later messages of its run.

    Attributes:
        wait_s: how long to wait, seconds.
    """

    def __init__(self, wait_s: float) -> None:
        super().__init__(wait_s)
        self.wait_s = wait_s


class BackgroundQuery(Generic[Question, Answer]):
    """Runs a query about one stream at a time, in its own thread."""

    def __init__(self, ask: Callable[Concatenate[str, Question], Answer]) -> None:
        """Call ``ask`` with a stream and further arguments; it waits for the answer."""
        self._ask = ask
        self._stream = ""
        self._answer: Future[Answer] | None = None

    def __call__(self, stream: str, *rest: Question.args, **named: Question.kwargs) -> Answer:
        """Return the answer, once; the next call starts a new query.

        The answer may be to an earlier question about the same stream, if a newer message has
        displaced the one for which it was asked.

        Raises:
            NotYet: the answer has not come; call again.
        """
        if self._answer is None or (self._answer.done() and self._stream != stream):
            self._stream, self._answer = stream, Future()
            ask = partial(self._ask, stream, *rest, **named)
            thread = threading.Thread(target=_wait, args=(ask, self._answer), daemon=True)
            thread.start()
            thread.join(_AT_ONCE_S)
        if self._stream != stream or not self._answer.done():
            raise NotYet(_AGAIN_S)
        answer, self._answer = self._answer, None
        return answer.result()


def _wait(ask: Callable[[], Any], answer: Future[Any]) -> None:
    try:
        answer.set_result(ask())
    except Exception as error:
        answer.set_exception(error)
