"""Joins the candidates of a frame by its sequence number, with a deadline.

Pure: it is told the time. Frames are released in the order of their numbers, each exactly once:
when all awaited channels have answered, or when their deadlines have passed. A channel is awaited
while it is alive and kept its last deadline; one that has missed a deadline is awaited again when
it next answers. So a dead or stopped channel holds up the stream for one deadline at most, and one
that is slow but answers is waited for.
"""

import heapq
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from placefield.matching.candidate import Candidate


@dataclass(frozen=True)
class Joined:
    """The candidates of one frame, by channel, and the channels that are missing."""

    sequence: int
    candidates: dict[int, Candidate]
    missing: frozenset[int]


@dataclass
class _Pending:
    since: float
    candidates: dict[int, Candidate] = field(default_factory=dict)


@dataclass(frozen=True)
class _Answer:
    sequence: int
    at: float


class Joiner:
    """Joins one stream. Counts ``duplicate``, ``late``, ``unknown_channel`` and ``partial``."""

    def __init__(
        self,
        channels: Iterable[int],
        deadline_s: float,
        counts: Counter[str],
        *,
        first: int = 0,
        gaps_expected: bool = False,
    ) -> None:
        """Expect these channels' candidates, each at most ``deadline_s`` after its frame.

        Frames before ``first`` have been answered.

        The deadline restarts whenever an awaited channel answers any frame.

        A frame is held back until those before it have been heard of: their source sends them
        again. Not so with ``gaps_expected``, as in a live stream that drops old frames.
        """
        self._channels = frozenset(channels)
        self._deadline_s = deadline_s
        self._counts = counts
        self._gaps_expected = gaps_expected
        self._alive = self._channels
        self._tardy: set[int] = set()
        self._latest: dict[int, _Answer] = {}
        self._pending: dict[int, _Pending] = {}
        self._in_order: list[int] = []  # the pending frames, as a heap
        self.next = first
        """The number of the oldest frame that is not released yet."""

    def set_alive(self, channels: Iterable[int]) -> None:
        """Say which channels have a living worker; the others are not awaited."""
        self._alive = self._channels & frozenset(channels)

    def announce(self, sequence: int, now: float) -> None:
        """Say that a frame is under way (``now`` in seconds, of any clock that never goes back)."""
        if sequence >= self.next:
            self._frame(sequence, now)

    def _frame(self, sequence: int, now: float) -> _Pending:
        """Return what is known of a frame; one that is new is of now."""
        if sequence not in self._pending:
            self._pending[sequence] = _Pending(now)
            heapq.heappush(self._in_order, sequence)
        return self._pending[sequence]

    def add(self, sequence: int, channel: int, candidate: Candidate, now: float) -> None:
        """Take a channel's candidate of a frame; a second one and one too late are dropped."""
        if channel not in self._channels:
            self._counts["unknown_channel"] += 1
            return
        self._tardy.discard(channel)
        if sequence < self.next:
            self._counts["late"] += 1
            return
        candidates = self._frame(sequence, now).candidates
        if channel in candidates:
            self._counts["duplicate"] += 1
            return
        candidates[channel] = candidate
        self._latest[channel] = _Answer(sequence, now)

    def release(self, now: float) -> list[Joined]:
        """Return the frames that are complete or due, in order; at ``math.inf`` all of them."""
        released: list[Joined] = []
        while self._in_order:
            sequence = self._in_order[0]
            pending = self._pending[sequence]
            absent = self._channels - pending.candidates.keys()
            awaited = self._awaited(sequence, absent)
            answers = [self._latest[c].at for c in awaited if c in self._latest]
            since = max([pending.since, *answers])
            is_due = not awaited or now >= since + self._deadline_s
            in_turn = sequence == self.next or self._gaps_expected or now == math.inf
            if not (is_due and in_turn):
                break
            self._tardy |= awaited
            released.append(self._release(sequence, absent))
        return released

    def _awaited(self, sequence: int, absent: frozenset[int]) -> frozenset[int]:
        """Which of the absent channels may still answer a frame.

        One that has dropped the frame in a live stream, and gone on, will not.
        """
        awaited = (absent & self._alive) - self._tardy
        if not self._gaps_expected:
            return awaited
        return awaited - {c for c, latest in self._latest.items() if latest.sequence > sequence}

    def _release(self, sequence: int, missing: frozenset[int]) -> Joined:
        self.next = sequence + 1
        self._counts["partial"] += bool(missing)
        heapq.heappop(self._in_order)
        candidates = self._pending.pop(sequence).candidates
        return Joined(sequence, dict(sorted(candidates.items())), missing)

    def skip_to(self, first: int) -> None:
        """Take the frames before this one as answered, whoever has done it."""
        self.next = max(self.next, first)
        while self._in_order and self._in_order[0] < self.next:
            del self._pending[heapq.heappop(self._in_order)]

    def is_released(self, sequence: int) -> bool:
        """Whether a frame is over."""
        return sequence < self.next

    @property
    def pending(self) -> int:
        """How many frames are not released yet."""
        return len(self._pending)
