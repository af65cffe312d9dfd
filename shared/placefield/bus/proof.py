"""How a source verifies which frames of a lossless stream have been answered.

Any client on the bus can publish an answer, which stands for a frame and all earlier frames. The
source accepts an answer only when the matches of all these frames have come.
"""

import threading
from collections import Counter

_KEPT = 1000
"""Answered frames that are still tracked: a frame that was sent again is answered again."""


class Proof:
    """Claimed answers, and the matches that prove them. Any thread may call the methods.

    Each time that a frame is sent, the fuser publishes its match once, and then its answer. The
    fuser may leave out an answer if the answer to a later frame stands for it.

    Attributes:
        matched: number of the first frame whose match has not come.
        forged: how many answers came before a match that they stand for, plus how many answers and
            matches came more often than the frame was sent.
    """

    def __init__(self) -> None:
        self.matched = 0
        self.forged = 0
        self._beyond: set[int] = set()
        """Frames beyond ``matched`` whose matches have come."""
        self._claimed: set[int] = set()
        """Frames, or the end, with a claimed but unproven answer; at most those under way."""
        self._answers_due, self._matches_due = Counter[int](), Counter[int]()
        self._lock = threading.Lock()

    def send(self, sequence: int) -> None:
        """Record that a frame, or the end, is being sent."""
        with self._lock:
            for due in (self._answers_due, self._matches_due):
                due[sequence] += 1
                if len(due) > 2 * _KEPT:
                    for old in [old for old in due if old < self.matched - _KEPT]:
                        del due[old]

    def claim(self, sequence: int, sent: int) -> int | None:
        """Record a claimed answer to a frame and all earlier frames.

        Args:
            sequence: number of the frame.
            sent: how many frames were sent; the end of the stream has the number after the last.

        Returns:
            The last frame that is proven to be answered; None: no more than before.
        """
        with self._lock:
            if self._is_proven(sequence, sent):
                self._mark_received(self._answers_due, sequence)
            else:
                self.forged += 1
            self._claimed.add(sequence)
            return self._proven(sent)

    def match(self, sequence: int, sent: int) -> int | None:
        """Record that the match of a frame has come; see ``claim``."""
        with self._lock:
            self._mark_received(self._matches_due, sequence)
            if sequence >= self.matched:
                self._beyond.add(sequence)
            while self.matched in self._beyond:
                self._beyond.discard(self.matched)
                self.matched += 1
            return self._proven(sent)

    def _mark_received(self, due: Counter[int], sequence: int) -> None:
        if due[sequence] > 0:
            due[sequence] -= 1
        else:
            self.forged += 1

    def _proven(self, sent: int) -> int | None:
        proven = {claimed for claimed in self._claimed if self._is_proven(claimed, sent)}
        self._claimed -= proven
        return max(proven, default=None)

    def _is_proven(self, claimed: int, sent: int) -> bool:
        return claimed < self.matched or claimed == self.matched == sent
