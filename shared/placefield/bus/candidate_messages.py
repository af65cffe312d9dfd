"""What channel workers say: candidates, smoothed frames, and what shards tell each other."""

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
        places: (n,) ascending, whose the evidence is; empty where it is every place's.
        evidence: (n,), or (K,) of every place; empty under ``ams`` and without answer.
        too_fast: posterior that the vehicle moves faster than the map resolves; 0 where the rule
            does not tell.
    """

    channel: Channel
    place: int = Field(ge=-1, lt=2**31)
    score: FiniteFloat
    places: IndexVector
    evidence: FloatVector
    too_fast: float = Field(0.0, ge=0, le=1)

    @classmethod
    def of(cls, channel: int, candidate: Candidate) -> Self:
        """Say whose candidate it is."""
        return cls(channel=channel, **vars(candidate))

    @property
    def candidate(self) -> Candidate:
        """The candidate, without the channel."""
        return Candidate(self.place, self.score, self.places, self.evidence, self.too_fast)


class _OfShard(OfMap):
    """Root of what is about a shard of a worker's channels.

    Attributes:
        shard: which part of the channels' places it is about.
        shards: of how many.
    """

    shard: int = Field(0, ge=0)
    shards: int = Field(1, ge=1, le=2**16)

    @model_validator(mode="after")
    def _check_shard(self) -> Self:
        if self.shard >= self.shards:
            raise PydanticCustomError("shard", "there is no such shard")
        return self


class SmoothedFrame(NamedTuple):
    """What a channel, or a shard of one, has smoothed of a frame in hindsight.

    Attributes:
        channel: whose it is.
        sequence: number of the frame.
        lag: how many frames after it are known.
        candidate: for the frame.
    """

    channel: int
    sequence: int
    lag: int
    candidate: Candidate


class SmoothedFrames(Strict):
    """SmoothedCandidate frames of a worker's channels, in a few arrays: they may be many.

    Attributes:
        channels: (m,) whose each is.
        before: (m,) how many frames before that of the message each is.
        lags: (m,) how many frames after it are known.
        best: (m,) index of its place, or -1 where there is no answer.
        scores: (m,) of that place.
        place_counts: (m,) how many of ``places`` are its own.
        places: those of all, one after the other; as in ``ChannelCandidate``.
        evidence_counts: (m,) how many of ``evidence`` are its own.
        evidence: that of all.
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
            raise PydanticCustomError("smoothed", "of some frames there is more than of others")
        if any((vector < 0).any() for vector in (self.channels, self.before, self.lags, *counts)):
            raise PydanticCustomError("smoothed", "a number is negative")
        if (self.channels >= 2**16).any() or (self.best < -1).any():
            raise PydanticCustomError("smoothed", "there is no such channel or place")
        if not np.isfinite(self.scores).all():
            raise PydanticCustomError("smoothed", "a score is not finite")
        if ((self.too_fast < 0) | (self.too_fast > 1)).any():
            raise PydanticCustomError("smoothed", "a posterior is not between 0 and 1")
        for count, vector in zip(counts, (self.places, self.evidence), strict=True):
            if int(count.sum(dtype=np.int64)) != len(vector):
                raise PydanticCustomError("smoothed", "places or evidence are not as many as said")
        return self

    @classmethod
    def of(cls, sequence: int, frames: Sequence[SmoothedFrame]) -> Self | None:
        """Pack what goes with the frame of this number; None if there is nothing.

        What is 2**31 frames before it, or more, is left out.
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
        """Yield what came with the frame of this number."""
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
    """The candidates of a worker's channels: together, for each message costs the fuser a wake-up.

    Attributes:
        rule: how they were made.
        candidates: one of each channel.
        smoothed: frames that the channels have smoothed since the message before; none: no frame.
        forgotten: whether the worker lacks frames of the stream that nobody remembered.
    """

    rule: Rule
    candidates: tuple[ChannelCandidate, ...] = Field(min_length=1)
    smoothed: SmoothedFrames | None = None
    forgotten: bool = False


class FinishedMessage(_OfShard):
    """What a worker's channels smooth at the end of a stream: all frames that are left.

    It goes with the end's header, and is the only end that has a payload.

    Attributes:
        rule: how candidates were made.
        channels: of the worker.
        smoothed: the frames; none: all had been smoothed.
    """

    rule: Rule
    channels: tuple[Channel, ...] = Field(min_length=1)
    smoothed: SmoothedFrames | None = None


class ChannelPartial(Strict):
    """What a channel's shards need of one of them, as part of a message."""

    channel: Channel
    partial: NumberVector


class HaloMessage(_OfShard):
    """What the shards of a worker tell those beside them of a frame.

    Attributes:
        partials: one of each channel.
    """

    partials: tuple[ChannelPartial, ...] = Field(min_length=1)
