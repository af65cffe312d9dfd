"""The messages of channel workers: candidates, smoothed frames and partial results of shards."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from placefield.bus.message import Channel, OfMap, Strict
from placefield.bus.wire import FloatVector, IndexVector, NumberVector
from placefield.config import Rule
from placefield.matching.candidate import Candidate


class ChannelCandidate(Strict):
    """A channel's candidate, as part of a message.

    Attributes:
        channel: whose it is.
        place: index of the place, or -1 where there is no answer.
        score: of that place.
        places: (n,) ascending, the places of the evidence; empty if the evidence has all places.
        evidence: (n,), or (K,) of all places; empty under ``ams`` and without an answer.
        too_fast: posterior that the vehicle moves faster than the map resolves; 0 if the rule does
            not estimate it.
    """

    channel: Channel
    place: int = Field(ge=-1, lt=2**31)
    score: FiniteFloat
    places: IndexVector
    evidence: FloatVector
    too_fast: float = Field(0.0, ge=0, le=1)

    @classmethod
    def of(cls, channel: int, candidate: Candidate) -> Self:
        """Return the message of a channel's candidate."""
        return cls(channel=channel, **vars(candidate))

    @property
    def candidate(self) -> Candidate:
        """The candidate, without the channel."""
        return Candidate(self.place, self.score, self.places, self.evidence, self.too_fast)


class _OfShard(OfMap):
    """Root of messages about one shard of a worker's channels.

    Attributes:
        shard: number of the shard, from 0.
        shards: how many shards each channel has.
    """

    shard: int = Field(0, ge=0)
    shards: int = Field(1, ge=1, le=2**16)

    @model_validator(mode="after")
    def _check_shard(self) -> Self:
        if self.shard >= self.shards:
            raise PydanticCustomError("shard", "the shard is not below the number of shards")
        return self


class SmoothedFrame(NamedTuple):
    """The smoothed candidate of a channel, or of a shard of a channel, for one frame.

    Attributes:
        channel: number of the channel.
        sequence: number of the frame.
        lag: how many later frames the smoothing used.
        candidate: for the frame.
    """

    channel: int
    sequence: int
    lag: int
    candidate: Candidate


class SmoothedFrames(Strict):
    """Smoothed candidates of a worker's channels, packed in a few arrays: there may be many.

    Each of the m rows is the smoothed candidate of one channel for one frame.

    Attributes:
        channels: (m,) the channel.
        before: (m,) how many frames the row's frame is before the frame of the message.
        lags: (m,) how many later frames the smoothing used.
        best: (m,) index of the place, or -1 where there is no answer.
        scores: (m,) of that place.
        place_counts: (m,) how many entries of ``places`` belong to the row.
        places: the places of all rows, one after the other; as in ``ChannelCandidate``.
        evidence_counts: (m,) how many entries of ``evidence`` belong to the row.
        evidence: the evidence of all rows, one after the other.
        too_fast: (m,) posterior that the vehicle moves faster than the map resolves.
    """

    channels: IndexVector
    before: IndexVector
    lags: IndexVector
    best: IndexVector
    scores: NumberVector
    place_counts: IndexVector
    places: IndexVector
    evidence_counts: IndexVector
    evidence: FloatVector
    too_fast: NumberVector

    @model_validator(mode="after")
    def _check(self) -> Self:
        counts = self.place_counts, self.evidence_counts
        of_frames = (self.channels, self.before, self.lags, self.best, self.scores, self.too_fast)
        each = (*of_frames, *counts)
        if len({len(vector) for vector in each}) > 1:
            raise PydanticCustomError("smoothed", "the arrays differ in length")
        if any((vector < 0).any() for vector in (self.channels, self.before, self.lags, *counts)):
            raise PydanticCustomError("smoothed", "a number is negative")
        if (self.channels >= 2**16).any() or (self.best < -1).any():
            raise PydanticCustomError("smoothed", "a channel or place is out of range")
        if not np.isfinite(self.scores).all():
            raise PydanticCustomError("smoothed", "a score is not finite")
        if ((self.too_fast < 0) | (self.too_fast > 1)).any():
            raise PydanticCustomError("smoothed", "a posterior is not between 0 and 1")
        for count, vector in zip(counts, (self.places, self.evidence), strict=True):
            if int(count.sum(dtype=np.int64)) != len(vector):
                raise PydanticCustomError(
                    "smoothed", "the counts do not add up to the places or evidence"
                )
        return self

    @classmethod
    def of(cls, sequence: int, frames: Sequence[SmoothedFrame]) -> Self | None:
        """Pack smoothed frames for the message of the frame ``sequence``; None if there are none.

        Smoothed frames that are 2**31 frames or more before it are left out.
        """
        frames = [frame for frame in frames if sequence - frame.sequence < 2**31]
        if not frames:
            return None
        candidates = [frame.candidate for frame in frames]
        return cls(
            channels=np.array([frame.channel for frame in frames], np.int32),
            before=np.array([sequence - frame.sequence for frame in frames], np.int32),
            lags=np.array([frame.lag for frame in frames], np.int32),
            best=np.array([candidate.place for candidate in candidates], np.int32),
            scores=np.array([candidate.score for candidate in candidates], np.float64),
            place_counts=np.array([len(each.places) for each in candidates], np.int32),
            places=np.concatenate([each.places for each in candidates]),
            evidence_counts=np.array([len(each.evidence) for each in candidates], np.int32),
            evidence=np.concatenate([each.evidence for each in candidates]),
            too_fast=np.array([candidate.too_fast for candidate in candidates], np.float64),
        )

    def frames(self, sequence: int) -> Iterator[SmoothedFrame]:
        """Yield the smoothed candidates of a message whose frame has this number."""
        numbers = (self.channels, self.before, self.lags, self.best, self.scores, self.too_fast)
        counts = (self.place_counts, self.evidence_counts)
        place_end = evidence_end = 0
        for channel, before, lag, best, score, too_fast, places, evidence in zip(
            *(vector.tolist() for vector in (*numbers, *counts)), strict=True
        ):
            first, place_end = place_end, place_end + places
            own_places = self.places[first:place_end]
            first, evidence_end = evidence_end, evidence_end + evidence
            own_evidence = self.evidence[first:evidence_end]
            candidate = Candidate(best, score, own_places, own_evidence, too_fast)
            yield SmoothedFrame(channel, sequence - before, lag, candidate)


class CandidatesMessage(_OfShard):
    """The candidates of a worker's channels for one frame.

    One message has them all, because each message costs the fuser a wake-up.

    Attributes:
        rule: the matching rule.
        candidates: one of each channel.
        smoothed: frames that the channels have smoothed since the previous message; None: no frame.
        forgotten: whether the worker missed frames of the stream that no replay cache had.
    """

    rule: Rule
    candidates: tuple[ChannelCandidate, ...] = Field(min_length=1)
    smoothed: SmoothedFrames | None = None
    forgotten: bool = False


class FinishedMessage(_OfShard):
    """The last smoothed frames of a worker's channels, at the end of a stream.

    It goes with the header of the stream's end. No other end of a stream has a payload.

    Attributes:
        rule: the matching rule.
        channels: of the worker.
        smoothed: the frames; None: all had been smoothed before.
    """

    rule: Rule
    channels: tuple[Channel, ...] = Field(min_length=1)
    smoothed: SmoothedFrames | None = None


class ChannelPartial(Strict):
    """The partial result of one shard of a channel, as part of a message."""

    channel: Channel
    partial: NumberVector


class HaloMessage(_OfShard):
    """The partial results of a worker's shards for one frame, the halo included.

    Attributes:
        partials: one of each channel.
    """

    partials: tuple[ChannelPartial, ...] = Field(min_length=1)
