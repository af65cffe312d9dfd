"""Time, so that what goes by it can be tested without waiting."""

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds since any time that is past."""

    def monotonic(self) -> float:
        """Return what time it is."""

    def sleep(self, seconds: float) -> None:
        """Wait."""


class RealClock:
    """The machine's."""

    def monotonic(self) -> float:
        """Return what time it is."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(seconds)
