"""One stream of frames in the channels of a worker, or in one shard of each channel.

Every frame takes two steps. The local step computes the partial result of the worker's shard. The
reduce step combines the partial results of all shards to candidates. A worker of whole channels has
the only shard, and does both steps at once. If there are several shards, each worker publishes its
partial results, and all shards of a channel work on the same frame. While a shard is away, the
others wait, and the fuser answers without the channel. A shard that returns fetches the missed
descriptors and partial results, and then all shards continue.
"""

import time
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

from placefield.bus.candidate_messages import (
    CandidatesMessage,
    ChannelCandidate,
    ChannelPartial,
    FinishedMessage,
    HaloMessage,
    SmoothedFrame,
    SmoothedFrames,
)
from placefield.bus.message import Header
from placefield.bus.refusing import counting_refused
from placefield.bus.replay_cache import LENGTH
from placefield.config import MatchingConfig, Rule
from placefield.matching.candidate import Candidate
from placefield.matching.channel_stage import ChannelStage, Compared
from placefield.matching.matcher import Partial, SmoothedCandidate
from placefield_services.background_query import NotYet
from placefield_services.channel_outputs import ChannelOutputs

_ASK_AFTER_S = 0.5  # without progress: a message from another shard may be lost


@dataclass(frozen=True)
class PendingFrame:
    """A frame to answer.

    Attributes:
        header: of the frame.
        compare: returns the comparison of the frame with the places, None for a missing
            observation; called once, when the frame is due.
        odometry_m: the odometer's reading at the frame, metres; None: unknown.
        is_awaited: whether to publish candidates; if not, the frame was answered before and only
            updates the matchers.
    """

    header: Header
    compare: Callable[[], Compared | None]
    odometry_m: float | None
    is_awaited: bool

    @cached_property
    def compared(self) -> Compared | None:
        """The comparison of the frame with the places; None: a missing observation."""
        return self.compare()


class ChannelStream:
    """Answers the frames of a stream in order; frames that did not come are missing observations.

    A frame that is lost to a defect is a missing observation in the channels that had not
    processed it.
    """

    def __init__(
        self,
        stage: ChannelStage,
        matching: MatchingConfig,
        digest: str,
        first: int,
        outputs: ChannelOutputs,
    ) -> None:
        """Begin a stream.

        Args:
            stage: of the channels.
            matching: the configuration of the matching.
            digest: of the channels' map.
            first: number of the first frame.
            outputs: of the run.
        """
        self._stage = stage
        self._map = digest
        self._rule: Rule = matching.rule
        self._lag = matching.lag
        self.is_forgotten = False
        """Whether earlier frames are missing that no replay cache had; see ``Match``."""
        self._smoothed: list[SmoothedFrame] = []
        """Smoothed frames that are not published yet."""
        self._outputs = outputs
        self._waiting: deque[PendingFrame] = deque()
        self._partials: defaultdict[int, dict[tuple[int, int], Partial]] = defaultdict(dict)
        """Partial results of each frame, by channel and shard."""
        self._begin(first)

    def _begin(self, first: int) -> None:
        """Begin again with the frame of this number."""
        self._stream = self._stage.new_stream(first)
        self._own: Mapping[int, Partial] | None = None
        """This worker's partial results of the next frame, once its local step is done."""
        self._tail: int | None = None
        """How many missing observations remain to be added at the end of the stream."""
        self._ask_at = time.monotonic() + _ASK_AFTER_S

    def add(self, frame: PendingFrame) -> None:
        """Add the next frame; it is answered in order."""
        self._waiting.append(frame)
        if len(self._waiting) > 2 * LENGTH:  # no replay cache has so many
            self._waiting.popleft()
            self._begin(self._waiting[0].header.sequence)
        self._go_on()

    def receive(self, header: Header, message: HaloMessage) -> None:
        """Receive the partial results of another worker's shards."""
        self._keep(header.sequence, message)
        self._go_on()

    def after_batch(self) -> None:
        """Fetch the partial results that the next frame waits for, at most twice a second."""
        if self._waiting and time.monotonic() >= self._ask_at:
            try:
                self._ask()
            except NotYet:
                return
            self._ask_at = time.monotonic() + _ASK_AFTER_S
            self._go_on()

    def _ask(self) -> None:
        began: dict[int, int] = {}  # by shard
        stream, first = self._waiting[0].header.stream, self._stream.next
        for header, payload in self._outputs.fetch_halos(stream, first, first + LENGTH):
            with counting_refused(self._outputs.counts):
                message = HaloMessage.decode(payload)
                if message.map == self._map:  # else of another version, or counted when it came
                    shard, sequence = message.shard, header.sequence
                    self._keep(sequence, message)
                    began[shard] = min(began.get(shard, sequence), sequence)
        begin = max(began.values(), default=first)
        if begin > first:  # another shard began again after the next frame
            while self._waiting and self._waiting[0].header.sequence < begin:
                self._waiting.popleft()
            self._begin(begin)

    def _keep(self, sequence: int, message: HaloMessage) -> None:
        """Keep the partial results of a shard until their frame is due."""
        if message.shards == self._stage.shards:
            for each in message.partials:
                self._keep_one(sequence, each.channel, message.shard, each.partial)

    def _keep_one(self, sequence: int, channel: int, shard: int, partial: Partial) -> None:
        is_near = self._stream.next <= sequence < self._stream.next + 2 * LENGTH
        if is_near and channel in self._stage.channels:
            self._partials[sequence].setdefault((channel, shard), partial)

    def _go_on(self) -> None:
        """Answer the next frames as long as the partial results of all shards are there."""
        while self._waiting:
            frame = self._waiting[0]
            if frame.header.end and self._is_over():
                self._waiting.popleft()
                self._finish(frame.header)
                continue
            try:
                if self._own is None:
                    self._local(frame)
                partials = self._all_partials()
                if partials is None:
                    return
                self._reduce(frame, partials)
            except Exception:
                # It must not stop the next frames.
                if self._waiting and self._waiting[0] is frame:
                    self._waiting.popleft()
                raise

    def _is_over(self) -> bool:
        """Return whether all missing observations at the end of the stream have been added."""
        if self._tail is None:
            self._tail = self._stream.end()
        return self._tail == 0

    def _local(self, frame: PendingFrame) -> None:
        """Do the local step of the next frame, and publish the partial results.

        The next frame is ``frame``, or a missed frame before it, or one after the end of the
        stream.
        """
        if frame.header.end:
            self._own = self._stream.local(None, self._stream.next)
        else:
            self._own = self._stream.local(frame.compared, frame.header.sequence, frame.odometry_m)
        sequence, shard, shards = self._stream.next, self._stage.shard, self._stage.shards
        for old in [old for old in self._partials if old < sequence]:
            del self._partials[old]
        for channel, partial in self._own.items():
            self._keep_one(sequence, channel, shard, partial)
        if shards > 1:
            partials = tuple(
                ChannelPartial(channel=channel, partial=partial)
                for channel, partial in self._own.items()
            )
            message = HaloMessage(map=self._map, shard=shard, shards=shards, partials=partials)
            self._outputs.halos.put(frame.header.of_frame(sequence), message)

    def _all_partials(self) -> dict[int, list[Partial]] | None:
        """Return the partial results of all shards for the next frame, by channel.

        None while a partial result is missing.
        """
        assert self._own is not None
        there = self._partials[self._stream.next]
        for channel, shard in list(there):
            if not self._stream.fits(channel, there[channel, shard]):
                del there[channel, shard]  # it has another map or rule
        shards = range(self._stage.shards)
        if any((channel, shard) not in there for channel in self._own for shard in shards):
            return None
        return {channel: [there[channel, shard] for shard in shards] for channel in self._own}

    def _reduce(self, frame: PendingFrame, partials: Mapping[int, list[Partial]]) -> None:
        """Do the reduce step of the next frame, and answer it unless it was missed."""
        del self._partials[self._stream.next]
        self._own, self._ask_at = None, time.monotonic() + _ASK_AFTER_S
        candidates = self._stream.reduce(partials)
        self._keep_smoothed(self._stream.smoothed())
        if self._tail:
            self._tail -= 1
            return
        sequence = frame.header.sequence
        if self._stream.next <= sequence:
            return
        self._waiting.popleft()
        if frame.is_awaited:
            self._outputs.candidates.put(frame.header, self._message(sequence, candidates))
        else:  # it was answered before, so frames that are older by the lag are not awaited
            self._smoothed = [old for old in self._smoothed if old.sequence + self._lag > sequence]

    def _message(self, sequence: int, candidates: Mapping[int, Candidate]) -> CandidatesMessage:
        return CandidatesMessage(
            map=self._map,
            rule=self._rule,
            shard=self._stage.shard,
            shards=self._stage.shards,
            candidates=tuple(ChannelCandidate.of(*each) for each in candidates.items()),
            smoothed=self._pop_smoothed(sequence),
            forgotten=self.is_forgotten,
        )

    def _finish(self, end: Header) -> None:
        """Smooth the last frames, and publish them with the end of the stream."""
        self._stream.finish()
        self._keep_smoothed(self._stream.smoothed())
        message = FinishedMessage(
            map=self._map,
            rule=self._rule,
            shard=self._stage.shard,
            shards=self._stage.shards,
            channels=self._stage.channels,
            smoothed=self._pop_smoothed(end.sequence),
        )
        self._outputs.candidates.put(end, message)

    def _keep_smoothed(self, smoothed: Mapping[int, list[tuple[int, SmoothedCandidate]]]) -> None:
        self._smoothed += [
            SmoothedFrame(channel, sequence, each.lag, each.candidate)
            for channel, frames in smoothed.items()
            for sequence, each in frames
        ]

    def _pop_smoothed(self, sequence: int) -> SmoothedFrames | None:
        smoothed, self._smoothed = self._smoothed, []
        return SmoothedFrames.of(sequence, smoothed)
