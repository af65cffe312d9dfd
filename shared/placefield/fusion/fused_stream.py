"""One stream from comparisons to matches, in one process: all channels, fused and smoothed."""

import math
from collections.abc import Sequence

from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match, SmoothedMatch
from placefield.fusion.smoothed_joiner import SmoothedJoiner
from placefield.matching.channel_stage import ChannelStage, Compared


class FusedStream:
    """Matches one stream in all channels of a stage of whole channels, and smooths it."""

    def __init__(self, channels: ChannelStage, fusion: FusionStage, lags: Sequence[int]) -> None:
        """Begin a stream.

        Args:
            channels: whole ones.
            fusion: of the same map and rule.
            lags: later frames that a smoothed match waits for at most, or ``WHOLE_DRIVE``; the
                stream is smoothed with each.
        """
        self._stream = channels.new_stream(lags=lags)
        self._fusion = fusion
        self._joiners = [SmoothedJoiner(channels.channels, lag) for lag in lags]
        self._smoothed: list[list[SmoothedMatch]] = [[] for _ in lags]

    @property
    def frames(self) -> int:
        """How many frames were matched."""
        return self._stream.next

    def update(self, compared: Compared | None, odometry_m: float | None = None) -> Match:
        """Match the next frame; None is a missing observation, or an unknown reading."""
        frame = self._stream.next
        match = self._fusion.fuse(self._stream.update(compared, odometry_m))
        for joiner in self._joiners:
            joiner.announce(frame)
        self._smooth(frame)
        return match

    def smoothed(self, which: int = 0) -> list[SmoothedMatch]:
        """Return the smoothed matches that are new since the last call.

        Every frame has one, in order, at most ``lag`` frames later, or when the stream is finished.

        Args:
            which: index of the lag among those of the stream.
        """
        smoothed, self._smoothed[which] = self._smoothed[which], []
        return smoothed

    def finish(self) -> None:
        """Smooth the remaining frames: the stream is over."""
        for _ in range(self._stream.end()):
            self._stream.update(None)
        self._stream.finish()
        self._smooth(math.inf)

    def _smooth(self, newest: float) -> None:
        """Fuse the smoothed candidates of the frames that wait no longer, with each lag."""
        for which, joiner in enumerate(self._joiners):
            for channel, frames in self._stream.smoothed(which).items():
                for frame, each in frames:
                    joiner.add(frame, channel, each)
            for joined in joiner.release(newest):
                match = self._fusion.fuse(list(joined.candidates.values()))
                self._smoothed[which].append(SmoothedMatch(joined.sequence, match, joined.lag))
