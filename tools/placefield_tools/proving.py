"""Which frames of a lossless stream have been answered, by a source's own books.

Whoever reaches the bus can say that a frame has been answered, and of all before it, too. It is
believed when their matches have come.
"""

import threading
import time

_SOON_S = 0.25  # an answer may come so long before its match: they come on threads of their own


class Proof:
    """Answers that were claimed, and the matches that prove them. Any thread may tell.

    Attributes:
        matched: number of the first frame whose match has not come.
        unproven: how many answers came long before the matches that they were of.
    """

    def __init__(self) -> None:
        self.matched = 0
        self.unproven = 0
        self._beyond: set[int] = set()
        """Frames beyond ``matched`` whose matches have come."""
        self._claims: dict[int, list[float]] = {}
        """When each was claimed to be answered; no more than are under way, and the end."""
        self._lock = threading.Lock()

    def claim(self, sequence: int) -> None:
        """Take that a frame is said to be answered, with all before it."""
        with self._lock:
            times = self._claims.setdefault(sequence, [])
            if len(times) < 1000:  # of a frame
                times.append(time.monotonic())
            else:
                self.unproven += 1

    def match(self, sequence: int) -> None:
        """Take that the match of a frame has come; it may come twice."""
        with self._lock:
            if sequence >= self.matched:
                self._beyond.add(sequence)
            while self.matched in self._beyond:
                self._beyond.discard(self.matched)
                self.matched += 1

    def proven(self, sent: int) -> int | None:
        """Return the last frame that is proven to be answered, of so many that were sent.

        The end of the stream is the one after the last of them. None: nothing new is.
        """
        with self._lock:
            proven = [claimed for claimed in self._claims if self._is_proven(claimed, sent)]
            soon = time.monotonic() - _SOON_S
            for claimed in proven:
                self.unproven += sum(at < soon for at in self._claims.pop(claimed))
            return max(proven, default=None)

    def _is_proven(self, claimed: int, sent: int) -> bool:
        return claimed < self.matched or claimed == self.matched == sent
