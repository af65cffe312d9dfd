"""Credits: the limit on unanswered frames of a lossless stream."""

import threading

WINDOW = 32
"""The most unanswered frames: enough that no service waits for the next frame, and each service can
handle several at once."""


class Credits:
    """Counts the frames that were sent and not yet answered."""

    def __init__(self, window: int = WINDOW) -> None:
        self._window = window
        self._sent = 0
        self._answered = 0
        self._changed = threading.Condition()

    def acquire(self, timeout: float) -> bool:
        """Wait for a credit for one more frame; False if there is none within ``timeout`` s."""
        with self._changed:
            if not self._changed.wait_for(self._has_credit, timeout):
                return False
            self._sent += 1
            return True

    def _has_credit(self) -> bool:
        return self._sent - self._answered < self._window

    def answer(self, sequence: int) -> None:
        """Return the credits of all frames up to this one."""
        with self._changed:
            self._answered = max(self._answered, sequence + 1)
            self._changed.notify_all()

    def wait_until_answered(self, sequence: int, timeout: float) -> bool:
        """Wait until this frame is answered; False if it is not within ``timeout`` seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: self._answered > sequence, timeout)

    @property
    def answered(self) -> int:
        """How many frames have been answered."""
        return self._answered
