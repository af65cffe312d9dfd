"""A clock that tests can replace, to test without waiting."""

import time
from typing import Protocol


class Clock(Protocol):
    """A monotonic clock, in seconds."""

    def monotonic(self) -> float:
        """Return the seconds since a fixed time."""

    def sleep(self, seconds: float) -> None:
        """Wait for so many seconds."""


class RealClock:
    """The clock of the machine."""

    def monotonic(self) -> float:
        """Return the seconds since a fixed time."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for so many seconds."""
        time.sleep(seconds)
