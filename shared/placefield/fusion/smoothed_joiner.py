"""Joins the channels' smoothed candidates of a frame, and decides when to stop waiting for them."""

from collections.abc import Iterable
from dataclasses import dataclass

from placefield.matching.candidate import Candidate
from placefield.matching.matcher import SmoothedCandidate


@dataclass(frozen=True)
class JoinedSmoothed:
    """The smoothed candidates of one frame.

    Attributes:
        sequence: number of the frame.
        candidates: by channel.
        missing: the channels that have not smoothed the frame.
        lag: number of later frames that they use, of the channel with the most.
    """

    sequence: int
    candidates: dict[int, Candidate]
    missing: frozenset[int]
    lag: int


class SmoothedJoiner:
    """Joins one stream: every announced frame is released once, in order."""

    def __init__(self, channels: Iterable[int], lag: int) -> None:
        """Wait for these channels to smooth a frame until ``lag`` more frames were answered."""
        self._channels = frozenset(channels)
        self._lag = lag
        self._pending: dict[int, dict[int, SmoothedCandidate]] = {}

    def announce(self, sequence: int) -> None:
        """Announce an answered frame; frames are announced in order."""
        self._pending.setdefault(sequence, {})

    def add(self, sequence: int, channel: int, smoothed: SmoothedCandidate) -> None:
        """Add a channel's smoothed candidate of an announced frame; a second one is dropped."""
        if sequence in self._pending and channel in self._channels:
            self._pending[sequence].setdefault(channel, smoothed)

    def release(self, newest: float) -> list[JoinedSmoothed]:
        """Return, in order, the frames that all channels have smoothed or whose wait is over.

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
