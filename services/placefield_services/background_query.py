"""Asking others without waiting for them: all runs share one loop, and one may be in trouble."""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

_AT_ONCE_S = 0.02  # most answers are there within
_AGAIN_S = 0.02

Question = ParamSpec("Question")
Answer = TypeVar("Answer")


class NotYet(Exception):  # noqa: N818  # no error
    """A message cannot be taken yet: it and those of its run that are behind it wait.

    Attributes:
        wait_s: for how long, seconds.
    """

    def __init__(self, wait_s: float) -> None:
        super().__init__(wait_s)
        self.wait_s = wait_s


class BackgroundQuery(Generic[Question, Answer]):
    """Asks of one stream at a time, in a thread of its own."""

    def __init__(self, ask: Callable[Concatenate[str, Question], Answer]) -> None:
        """Take what asks of a stream, and waits for the answer."""
        self._ask = ask
        self._stream = ""
        self._answer: Future[Answer] | None = None

    def __call__(self, stream: str, *rest: Question.args, **named: Question.kwargs) -> Answer:
        """Return the answer, once; it is asked for anew then.

        It may be that to an older question of the same stream: the message for which that was asked
        may have made room for a newer one.

        Raises:
            NotYet: it has not come; call again.
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
