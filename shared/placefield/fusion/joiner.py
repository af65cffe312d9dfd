"""Joins the candidates of a frame by its sequence number, with a deadline.

It has no clock: the caller gives the time. Frames are released in the order of their numbers, each
exactly once: when all awaited channels have answered, or when their deadlines have passed. A
channel is awaited while it is alive and met its last deadline; one that missed a deadline is
awaited again after its next answer. So a dead or stopped channel holds up the stream for at most
one deadline, and a channel that is slow but answers is waited for.
"""

import heapq
import math
from collections import Counter
from collections.abc import Collection, Iterable
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
        """Wait for these channels' candidates, for at most ``deadline_s`` after a frame.

        Frames before ``first`` have been answered.

        The deadline restarts whenever an awaited channel answers any frame.

        A frame is held back until all frames before it were announced, because a lossless source
        sends missing frames again. With ``gaps_expected``, as in a live stream that drops old
        frames, it is not held back.
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
        """Set the channels that have a living worker; the others are not awaited."""
        self._alive = self._channels & frozenset(channels)

    def announce(self, sequence: int, now: float) -> None:
        """Announce a frame under way (``now`` in seconds, of any clock that never goes back)."""
        if sequence >= self.next:
            self._frame(sequence, now)

    def _frame(self, sequence: int, now: float) -> _Pending:
        """Return the state of a frame; that of a new frame begins now."""
        if sequence not in self._pending:
            self._pending[sequence] = _Pending(now)
            heapq.heappush(self._in_order, sequence)
        return self._pending[sequence]

    def add(self, sequence: int, channel: int, candidate: Candidate, now: float) -> None:
        """Add a channel's candidate of a frame; a second one or a late one is dropped."""
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
        """Return which of the absent channels may still answer a frame.

        A channel of a live stream that has answered a later frame will not.
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

    def is_complete(self, sequence: int, channels: Collection[int]) -> bool:
        """Whether these channels, one at least, have answered a frame that is not released yet."""
        pending = self._pending.get(sequence)
        if pending is None or not pending.candidates:
            return False
        return pending.candidates.keys() >= set(channels)

    def first_complete(self, channels: Collection[int]) -> int | None:
        """Return the oldest frame that is complete for these channels; None: there is none."""
        in_order = sorted(self._in_order)
        return next((each for each in in_order if self.is_complete(each, channels)), None)

    def skip_to(self, first: int) -> None:
        """Count the frames before this one as answered by another fuser."""
        self.next = max(self.next, first)
        while self._in_order and self._in_order[0] < self.next:
            del self._pending[heapq.heappop(self._in_order)]

    def is_released(self, sequence: int) -> bool:
        """Whether a frame was released."""
        return sequence < self.next

    @property
    def pending(self) -> int:
        """Number of frames that are not released yet."""
        return len(self._pending)
