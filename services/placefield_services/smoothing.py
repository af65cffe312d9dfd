"""The smoothed candidates of a stream's frames, joined over shards and channels."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable

from placefield.bus.candidate_messages import CandidatesMessage, FinishedMessage, SmoothedFrame
from placefield.bus.message import Header
from placefield.bus.replay_cache import LENGTH
from placefield.fusion.smoothed_joiner import JoinedSmoothed, SmoothedJoiner
from placefield.matching.matcher import SmoothedCandidate
from placefield_services.fusion_parts import FusionParts

Released = list[tuple[Header, JoinedSmoothed]]
"""Frames with their smoothed candidates, in order."""


class Smoothing:
    """Releases each answered frame of a stream once, in order, with its smoothed candidates.

    A frame waits until all channels have smoothed it, or until ``lag`` more frames are answered.
    At the end the rest wait for what living channels still have, as long as for a candidate.
    """

    def __init__(self, parts: FusionParts) -> None:
        """Begin a stream."""
        self._decoder = parts.decoder
        self._all = parts.channels.all
        self.lag = parts.config.matching.lag
        """How many frames after it a frame waits for at most."""
        self._deadline_s = parts.config.fusion.deadline_s
        self._joiner = SmoothedJoiner(self._all, self.lag)
        self._shards = parts.stage.new_joiner()
        self._answered: dict[int, Header] = {}  # and not released yet
        self._newest = -1
        self._unanswered: defaultdict[int, list[tuple[int, SmoothedCandidate]]] = defaultdict(list)
        """What channels have smoothed of frames that are not answered yet, by frame."""
        self._finished: defaultdict[tuple[int, int], set[int]] = defaultdict(set)
        """Shards whose stream is over, by channel and how many there are."""
        self._end: Header | None = None
        self._latest = -math.inf  # when what the end waits for came last

    def add(self, sequence: int, message: CandidatesMessage | FinishedMessage, now: float) -> None:
        """Add what a worker's channels have smoothed, from the message of a frame or of the end."""
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
        if message.shards > 1:  # a whole channel's was checked when it was decoded
            self._decoder.check_smoothed(frame._replace(candidate=candidate))
        smoothed = SmoothedCandidate(candidate, frame.lag)
        if frame.sequence <= self._newest:
            self._joiner.add(frame.sequence, frame.channel, smoothed)
            return
        self._unanswered[frame.sequence].append((frame.channel, smoothed))
        if len(self._unanswered) > LENGTH:
            del self._unanswered[next(iter(self._unanswered))]

    def announce(self, header: Header) -> None:
        """Say that a frame was answered; one that is not newer than the last is known already."""
        sequence = header.sequence
        if sequence <= self._newest:
            return
        self._newest = sequence
        self._answered[sequence] = header
        self._joiner.announce(sequence)
        for channel, smoothed in self._unanswered.pop(sequence, ()):
            self._joiner.add(sequence, channel, smoothed)
        for old in [old for old in self._unanswered if old < sequence]:
            del self._unanswered[old]

    @property
    def answered(self) -> list[Header]:
        """The answered frames that are not smoothed yet, in order."""
        return list(self._answered.values())

    def release(self) -> Released:
        """Return the frames that are due."""
        return self._with_headers(self._joiner.release(self._newest))

    def release_all(self) -> Released:
        """Return all frames that wait: the stream is over."""
        return self._with_headers(self._joiner.release(math.inf))

    def _with_headers(self, released: Iterable[JoinedSmoothed]) -> Released:
        frames = [(self._answered.pop(joined.sequence), joined) for joined in released]
        if frames:
            self._shards.forget_before(frames[-1][1].sequence + 1)
        return frames

    def end(self, header: Header, now: float) -> None:
        """Say that the stream is over; it may be said again."""
        if self._end is None:
            self._end = header
            self._latest = max(self._latest, now)

    def pop_end(self, alive: Collection[int], now: float) -> Header | None:
        """Return the end's header, once: when the stream is over and no living channel has more."""
        if self._end is None:
            return None
        awaited = set(alive) - self._finished_channels()
        if self._answered and awaited and now < self._latest + self._deadline_s:
            return None
        end, self._end = self._end, None
        return end

    def _finished_channels(self) -> set[int]:
        return {
            channel for (channel, shards), there in self._finished.items() if len(there) == shards
        }
