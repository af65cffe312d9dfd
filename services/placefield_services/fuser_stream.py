"""One stream in the fuser: the candidates of each frame are joined, and its match is published."""

import math

from placefield.bus.candidate_messages import CandidatesMessage, FinishedMessage
from placefield.bus.credits import WINDOW
from placefield.bus.message import Header
from placefield.fusion.joiner import Joiner
from placefield_services.fusion_parts import FusionParts
from placefield_services.smoothing import Released, Smoothing


class FuserStream:
    """Joins the candidates of each frame of one stream, and has its match published once.

    The stream ends when the featurizer has said so and every frame has been answered. Its source
    gets the credit of the end when all smoothed matches are out, too.
    """

    def __init__(self, parts: FusionParts, first: int, *, live: bool) -> None:
        """Begin a stream; its frames before ``first`` have been answered."""
        self.live = live
        """Whether its source drops old frames."""
        self._channels = parts.channels
        self._decoder = parts.decoder
        self._publisher = parts.publisher
        self._counts = parts.counts
        self._joiner = Joiner(
            parts.channels.all,
            parts.config.fusion.deadline_s,
            parts.counts,
            first=first,
            gaps_expected=live,
        )
        self._shards = parts.stage.new_joiner()
        self.smoothing = Smoothing(parts)
        self.is_forgotten = False
        """Whether nobody remembered enough of the stream; see ``Match``."""
        self._headers: dict[int, Header] = {}
        self._end: Header | None = None
        self._has_ended = False

    def is_released(self, sequence: int) -> bool:
        """Whether a frame has been answered."""
        return self._joiner.is_released(sequence)

    def skip_to(self, sequence: int) -> bool:
        """Count the frames before this one as answered, by another fuser; False if they were."""
        if sequence <= self._joiner.next:
            return False
        self._joiner.skip_to(sequence)
        return True

    @property
    def next(self) -> int:
        """The number of the oldest frame that is not answered yet."""
        return self._joiner.next

    @property
    def oldest_unsmoothed(self) -> int:
        """The number of the oldest frame that is not smoothed yet, answered or not."""
        answered = self.smoothing.answered
        return answered[0].sequence if answered else self.next

    @property
    def is_ending(self) -> bool:
        """Whether no frame comes any more."""
        return self._has_ended

    def is_complete(self, sequence: int) -> bool:
        """Whether all living channels have answered a frame that is not released yet."""
        return self._joiner.is_complete(sequence, self._channels.alive)

    def first_complete(self) -> int | None:
        """Return the oldest unanswered frame that all living channels have answered, or None."""
        return self._joiner.first_complete(self._channels.alive)

    def forget_before(self, sequence: int) -> None:
        """Answer no frames before this one: another stream does."""
        self._joiner.skip_to(sequence)
        self._forget_before(sequence)

    def continue_from(self, other: "FuserStream", now: float) -> None:
        """Answer and smooth the frames that the same stream under another version has not."""
        self._joiner.skip_to(other.next)
        self.is_forgotten |= other.is_forgotten
        for header in other.smoothing.answered:
            self.smoothing.announce(header)
        for header in list(other._headers.values()):
            self.announce(header, now)

    def is_out_of_order(self, header: Header) -> bool:
        """Whether a frame of a lossless stream is further ahead than any that can be under way."""
        return header.sequence > self._joiner.next + 2 * WINDOW

    def announce(self, header: Header, now: float) -> None:
        """Say that a frame is under way."""
        self._know(header)
        self._joiner.announce(header.sequence, now)

    def add(self, header: Header, message: CandidatesMessage | FinishedMessage, now: float) -> None:
        """Add what a worker's channels answer for a frame, and what they have smoothed.

        Raises:
            MessageError: the candidates of a channel's shards are, joined, of another map.
        """
        self.smoothing.add(header.sequence, message, now)
        if isinstance(message, CandidatesMessage):
            if self.live and self._joiner.is_released(header.sequence):
                self._publisher.acknowledge(header)  # it may have had no credit, see below
            self._know(header)
            self._add(header.sequence, message, now)

    def _know(self, header: Header) -> None:
        if not self._joiner.is_released(header.sequence):
            self._headers[header.sequence] = header

    def _add(self, sequence: int, message: CandidatesMessage, now: float) -> None:
        whole = []
        for each in message.candidates:
            if each.channel not in self._channels.all:
                self._counts["unknown_channel"] += 1
                continue
            part = message.shard, message.shards
            joined = self._shards.add(sequence, each.channel, *part, each.candidate)
            if joined is not None:
                if message.shards > 1:  # a whole channel's was checked when it was decoded
                    self._decoder.check(joined)
                whole.append((each.channel, joined))
        for channel, candidate in whole:
            self._joiner.add(sequence, channel, candidate, now)

    def end(self, header: Header) -> None:
        """Say that no frame comes any more."""
        self._end, self._has_ended = header, True

    def release(self, now: float) -> None:
        """Publish the matches of frames that are complete or due, smoothed ones, and a credit.

        The credit of the last frame stands for all before it.
        """
        last = self._release_matches(now)
        self._publish_smoothed(self.smoothing.release())
        if self._end is not None and self._is_over(self._end):
            self._publisher.end_matches(self._end)
            self.smoothing.end(self._end, now)
            self._end = None
        end = self.smoothing.pop_end(self._channels.alive, now)
        if end is not None:
            self._publish_smoothed(self.smoothing.release_all())
            self._publisher.end_smoothed(end)
            last = end
        if last is not None:
            self._publisher.acknowledge(last)

    def _release_matches(self, now: float) -> Header | None:
        """Publish the matches that are due; return the header of the last that has its credit.

        A live frame that living channels have not answered yet has its credit once they have. With
        more cameras than they can follow, the featurizer would else describe more and more frames,
        and take the processors from them.
        """
        self._joiner.set_alive(self._channels.alive)
        last = credited = None
        for joined in self._joiner.release(now):
            last = self._headers[joined.sequence]
            self._publisher.publish(last, joined, forgotten=self.is_forgotten)
            self.smoothing.announce(last)
            if joined.candidates or not (self.live and self._channels.alive):
                credited = last
        if last is not None:
            self._forget_before(last.sequence)
        return credited

    def _forget_before(self, sequence: int) -> None:
        self._shards.forget_before(sequence)
        for old in [old for old in self._headers if old < sequence]:
            del self._headers[old]

    def _is_over(self, end: Header) -> bool:
        """Whether all frames are answered; of a lossless stream also those not received yet."""
        return not self._joiner.pending and (end.live or self._joiner.next >= end.sequence)

    def abandon(self) -> None:
        """Publish all that waits, complete or not: another stream has begun."""
        self.release(math.inf)
        self._publish_smoothed(self.smoothing.release_all())

    def _publish_smoothed(self, released: Released) -> None:
        for header, joined in released:
            self._publisher.publish_smoothed(header, joined, forgotten=self.is_forgotten)
