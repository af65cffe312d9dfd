"""One stream from comparisons to matches, in one process: all channels, fused and smoothed."""

import math
from collections.abc import Mapping

from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match, SmoothedMatch
from placefield.fusion.smoothed_joiner import SmoothedJoiner
from placefield.matching.channel_stage import ChannelStage, Compared
from placefield.matching.matcher import SmoothedCandidate


class FusedStream:
    """Matches one stream in all channels of a stage of whole channels.

    Streams of one stage may share the comparisons of the same frames.
    """

    def __init__(self, channels: ChannelStage, fusion: FusionStage, lag: int) -> None:
        """Begin a stream, whose frames wait for at most ``lag`` later ones, or ``WHOLE_DRIVE``."""
        self._stream = channels.new_stream(lag=lag)
        self._fusion = fusion
        self._joiner = SmoothedJoiner(channels.channels, lag)
        self._smoothed: list[SmoothedMatch] = []

    @property
    def frames(self) -> int:
        """How many frames were matched."""
        return self._stream.next

    def update(self, compared: Compared | None, odometry_m: float | None = None) -> Match:
        """Match the next frame; None is a missing observation, or an unknown reading."""
        frame = self._stream.next
        match = self._fusion.fuse(self._stream.update(compared, odometry_m))
        self._joiner.announce(frame)
        self._smooth(self._stream.smoothed(), frame)
        return match

    def smoothed(self) -> list[SmoothedMatch]:
        """Return the smoothed matches that are new since the last call.

        Every frame has one, in order, at most ``lag`` frames later, or when the stream is finished.
        """
        smoothed, self._smoothed = self._smoothed, []
        return smoothed

    def finish(self) -> list[SmoothedMatch]:
        """Return the remaining smoothed matches: the stream is over."""
        for _ in range(self._stream.end()):
            self._stream.update(None)
        self._smooth(self._stream.finish(), math.inf)
        return self.smoothed()

    def _smooth(
        self, smoothed: Mapping[int, list[tuple[int, SmoothedCandidate]]], newest: float
    ) -> None:
        for channel, frames in smoothed.items():
            for frame, each in frames:
                self._joiner.add(frame, channel, each)
        for joined in self._joiner.release(newest):
            match = self._fusion.fuse(list(joined.candidates.values()))
            self._smoothed.append(SmoothedMatch(joined.sequence, match, joined.lag))
