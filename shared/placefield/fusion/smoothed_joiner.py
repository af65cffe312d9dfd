"""Joins what channels have smoothed of a frame in hindsight, and says when none is waited for."""

from collections.abc import Iterable
from dataclasses import dataclass

from placefield.matching.candidate import Candidate
from placefield.matching.matcher import SmoothedCandidate


@dataclass(frozen=True)
class JoinedSmoothed:
    """What channels have smoothed of one frame.

    Attributes:
        sequence: number of the frame.
        candidates: by channel.
        missing: the channels that have not smoothed it.
        lag: how many frames after it are known, in the channel that took the most.
    """

    sequence: int
    candidates: dict[int, Candidate]
    missing: frozenset[int]
    lag: int


class SmoothedJoiner:
    """Joins one stream: every frame that is announced is released once, in order."""

    def __init__(self, channels: Iterable[int], lag: int) -> None:
        """Expect these channels to smooth every frame when so many more have been answered."""
        self._channels = frozenset(channels)
        self._lag = lag
        self._pending: dict[int, dict[int, SmoothedCandidate]] = {}

    def announce(self, sequence: int) -> None:
        """Say that a frame was answered; frames are announced in order."""
        self._pending.setdefault(sequence, {})

    def add(self, sequence: int, channel: int, smoothed: SmoothedCandidate) -> None:
        """Take what a channel has smoothed of a frame that was announced; a second is dropped."""
        if sequence in self._pending and channel in self._channels:
            self._pending[sequence].setdefault(channel, smoothed)

    def release(self, newest: float) -> list[JoinedSmoothed]:
        """Return the frames that all channels have smoothed, or none will any more, in order.

        Args:
            newest: number of the newest frame that was answered; infinity at the stream's end.
        """
        released = []
        while self._pending:
            sequence, smoothed = next(iter(self._pending.items()))
            missing = self._channels - smoothed.keys()
            if missing and newest < sequence + self._lag:
                break
            del self._pending[sequence]
            lag = max((each.lag for each in smoothed.values()), default=self._lag)
            candidates = {channel: smoothed[channel].candidate for channel in sorted(smoothed)}
            released.append(JoinedSmoothed(sequence, candidates, missing, lag))
        return released
