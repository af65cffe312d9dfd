"""The smoothed matches of a stream: what channels have smoothed, joined, fused and published."""

import math
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable
from dataclasses import replace

from placefield.bus.candidate_messages import CandidatesMessage, FinishedMessage, SmoothedFrame
from placefield.bus.message import Header
from placefield.bus.messages import SmoothedMessage
from placefield.bus.replay_cache import LENGTH, CachedPublisher
from placefield.config import Config
from placefield.errors import MessageError
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match
from placefield.fusion.smoothed_joiner import JoinedSmoothed, SmoothedJoiner
from placefield.maps.map import Map
from placefield.matching.candidate import UNANSWERED
from placefield.matching.matcher import SmoothedCandidate
from placefield_services.process import counting_failure


class Smoothing:
    """Publishes one smoothed match, in order, for each frame of a stream that was answered.

    A frame waits until all channels have smoothed it, or until ``lag`` frames after it are.
    At the end the rest wait for what living channels still have, as long as for a candidate.
    """

    def __init__(
        self,
        placemap: Map,
        stage: FusionStage,
        config: Config,
        outbox: CachedPublisher,
        counts: Counter[str],
    ) -> None:
        self._map = placemap
        self._stage = stage
        self._all = range(len(placemap.channels))
        self.lag = config.matching.lag
        """How many frames after it a frame waits for at most."""
        self._deadline_s = config.fusion.deadline_s
        self._outbox = outbox
        self._counts = counts
        self._joiner = SmoothedJoiner(self._all, self.lag)
        self._shards = stage.new_joiner()
        self.is_forgotten = False
        """Whether nobody remembered enough of the stream; see ``Match``."""
        self._answered: dict[int, Header] = {}  # and not smoothed yet
        self._newest = -1
        self._ahead: defaultdict[int, list[tuple[int, SmoothedCandidate]]] = defaultdict(list)
        """SmoothedCandidate frames, by channel, that are not answered yet."""
        self._finished: defaultdict[tuple[int, int], set[int]] = defaultdict(set)
        """Shards whose stream is over, by channel and how many there are."""
        self._end: Header | None = None
        self._latest = -math.inf  # when what the end waits for came last

    def check(self, message: CandidatesMessage | FinishedMessage) -> None:
        """Check what a worker's channels have smoothed.

        Raises:
            MessageError: it is of another map, or another lag.
        """
        for frame in [] if message.smoothed is None else message.smoothed.frames(0):
            self._check(frame, message.shards)

    def _check(self, frame: SmoothedFrame, shards: int) -> None:
        if not self._stage.fits(frame.candidate, shards):
            raise MessageError("smoothed by a channel of another map")
        if frame.lag > self.lag:
            raise MessageError(
                f"smoothed after {frame.lag} frames, this fuser's lag is {self.lag}: "
                "give both one matching.lag"
            )

    def add(self, sequence: int, message: CandidatesMessage | FinishedMessage, now: float) -> None:
        """Take what a worker's channels have smoothed, of the message of a frame, or of the end."""
        for frame in [] if message.smoothed is None else message.smoothed.frames(sequence):
            if frame.channel in self._all and self._is_awaited(frame.sequence):
                self._add(frame, message)
        if isinstance(message, FinishedMessage):
            for channel in message.channels:
                self._finished[channel, message.shards].add(message.shard)
        self._latest = now

    def _is_awaited(self, sequence: int) -> bool:
        return sequence > self._newest or sequence in self._answered

    def _add(self, frame: SmoothedFrame, message: CandidatesMessage | FinishedMessage) -> None:
        part = message.shard, message.shards
        candidate = self._shards.add(frame.sequence, frame.channel, *part, frame.candidate)
        if candidate is None:
            return
        if message.shards > 1:  # a whole channel's was checked as it came
            self._check(frame._replace(candidate=candidate), 1)
        smoothed = SmoothedCandidate(candidate, frame.lag)
        if frame.sequence <= self._newest:
            self._joiner.add(frame.sequence, frame.channel, smoothed)
            return
        self._ahead[frame.sequence].append((frame.channel, smoothed))
        if len(self._ahead) > LENGTH:
            del self._ahead[next(iter(self._ahead))]

    def announce(self, header: Header) -> None:
        """Say that a frame was answered; one that is not newer than the last is known already."""
        sequence = header.sequence
        if sequence <= self._newest:
            return
        self._newest = sequence
        self._answered[sequence] = header
        self._joiner.announce(sequence)
        for channel, smoothed in self._ahead.pop(sequence, ()):
            self._joiner.add(sequence, channel, smoothed)
        for old in [old for old in self._ahead if old < sequence]:
            del self._ahead[old]

    def release(self) -> None:
        """Publish the smoothed matches that are due."""
        self._publish(self._joiner.release(self._newest))

    def end(self, header: Header, now: float) -> None:
        """Say that the stream is over; it may be said again."""
        if self._end is None:
            self._end = header
            self._latest = max(self._latest, now)

    def finish(self, alive: Collection[int], now: float) -> Header | None:
        """Publish all that is left, once the stream is over and no living channel has more of it.

        Returns:
            The end's header, once, when it has been published.
        """
        if self._end is None:
            return None
        awaited = set(alive) - self._finished_channels()
        if self._answered and awaited and now < self._latest + self._deadline_s:
            return None
        end, self._end = self._end, None
        self._publish(self._joiner.release(math.inf))
        self._outbox.put(end)
        return end

    def abandon(self) -> None:
        """Publish what there is of the frames that wait: another stream has begun."""
        self._publish(self._joiner.release(math.inf))

    def _finished_channels(self) -> set[int]:
        return {
            channel for (channel, shards), there in self._finished.items() if len(there) == shards
        }

    def _publish(self, released: Iterable[JoinedSmoothed]) -> None:
        for joined in released:
            header = self._answered.pop(joined.sequence)
            match = replace(self._fuse(joined), forgotten=self.is_forgotten)
            message = SmoothedMessage.of(match, map=self._map.digest, lag=joined.lag)
            self._outbox.put(header, message)
            self._counts["smoothed"] += 1
            self._shards.forget_before(joined.sequence + 1)

    def _fuse(self, joined: JoinedSmoothed) -> Match:
        """Make one match of a frame's candidates; a defect costs its answer, and no other's."""
        with counting_failure([self._counts]):
            return self._stage.fuse(list(joined.candidates.values()), sorted(joined.missing))
        return Match(UNANSWERED, 0.0, tuple(self._all))
