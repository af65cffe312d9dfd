"""What travels on the bus: msgpack with a schema version.

Every data message has a ``Header`` in its attachment; the payload is one of the other models.
Decoding checks everything: what does not parse raises ``MessageError`` and goes no further.
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields
from typing import Annotated, Any, Literal, NamedTuple, Self

import msgpack
import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from placefield.bus.wire import FloatVector, Image, IndexVector, NumberVector, Sums, unpack
from placefield.config import Rule
from placefield.errors import MessageError, OtherMapError
from placefield.fusion.match import Match
from placefield.matching.candidate import Candidate
from placefield.pose import Pose as PlacePose

MAX_BYTES = 128 * 2**20
"""No message is larger than this."""

Channel = Annotated[int, Field(ge=0, lt=2**16)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
Pose = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Metres = Annotated[FiniteFloat, Field(ge=0)]
"""What an odometer says: travelled since any start of its own. If it falls, it began anew."""


class _Strict(BaseModel):
    """Takes no field that it does not know, and no value of another type."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, arbitrary_types_allowed=True
    )


class Message(_Strict):
    """Root of all messages."""

    version: Literal[1] = 1  # of the schema

    def encode(self) -> bytes:
        """Return the message as msgpack."""
        packed: bytes = msgpack.packb(self.model_dump())
        return packed

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a message back.

        Raises:
            MessageError: it is too large, no msgpack, or not a message of this kind and version.
        """
        if len(data) > MAX_BYTES:
            raise MessageError(f"{cls.__name__}: {len(data)} bytes, more than {MAX_BYTES}")
        try:
            message = cls.model_validate(unpack(data))
        except ValidationError as error:
            first = error.errors(include_url=False, include_context=False, include_input=False)[0]
            where = ".".join(str(part) for part in first["loc"])
            # A stranger may have named the field: quoted and cut, it stays one line of a log.
            raise MessageError(f"{cls.__name__}: {where!r:.80}: {first['msg']}") from None
        except Exception as error:  # msgpack raises a dozen kinds, RecursionError among them
            why = str(error) or type(error).__name__
            raise MessageError(f"{cls.__name__}: no msgpack: {why}") from None
        if "version" not in message.model_fields_set:
            raise MessageError(f"{cls.__name__}: has no version")
        return message


class Header(Message):
    """Which frame of which stream a message is about; travels as the attachment.

    Attributes:
        stream: name of the stream, new for every replay.
        sequence: number of the frame in its stream, from 0, with no gaps at the source.
        stamp_ns: when the frame was taken, as its source has it, nanoseconds.
        live: whether old frames may be dropped for new ones.
        oldest: the frame of lowest number that its source awaits an answer of, in a stream that
            is not live; not later than this one.
        end: marks the end of the stream; the message has no payload, and its sequence is the
            number of frames.
    """

    stream: str = Field(min_length=1, max_length=64)
    sequence: int = Field(ge=0, lt=2**48)  # so that sums of gaps stay within msgpack's integers
    stamp_ns: int = Field(ge=-(2**63), lt=2**63)
    live: bool = False
    oldest: int = Field(0, ge=0, lt=2**48)
    end: bool = False

    @model_validator(mode="after")
    def _check_oldest(self) -> Self:
        if self.oldest > self.sequence:
            raise PydanticCustomError("oldest", "the oldest frame awaited is later than this one")
        return self

    def of_frame(self, sequence: int) -> "Header":
        """Return the header of another frame of the stream, which is not its end."""
        oldest = min(self.oldest, sequence)
        return self.model_copy(update={"sequence": sequence, "oldest": oldest, "end": False})


class FrameMessage(Message):
    """A frame: an encoded image as bytes, or pixels, with the odometry's reading, if any."""

    image: Image
    odometry_m: Metres | None = None


class FeatureMessage(Message):
    """A frame's descriptor, (N,), none if the image could not be read; and the frame's reading.

    ``forgotten`` says that nobody remembered enough of the stream for the featurizer to go on.
    """

    model: str = Field(max_length=64)  # fingerprint of what made the descriptor
    descriptor: FloatVector | None
    odometry_m: Metres | None = None
    forgotten: bool = False


class UnseenMessage(Message):
    """Why a frame goes on as one not seen: no image can be made of it, or it shows nothing."""

    reason: Literal["unreadable", "blank"]


class _OfMap(Message):
    """Root of what names places, and so says of which map they are.

    Attributes:
        map: its digest, see ``placefield.maps.map.Map``.
    """

    map: Digest

    def check_map(self, digest: str) -> None:
        """Refuse what is of another map than the one of this digest.

        Raises:
            OtherMapError: it is.
        """
        if self.map != digest:
            raise OtherMapError(
                f"{type(self).__name__} of map {self.map}, not {digest}: give all one map"
            )


class ChannelCandidate(_Strict):
    """A channel's candidate, as part of a message.

    Attributes:
        channel: whose it is.
        place: index of the place, or -1 where there is no answer.
        score: of that place.
        places: (n,) ascending, whose the evidence is; empty where it is every place's.
        evidence: (n,), or (K,) of every place; empty under ``lowest-score`` and without answer.
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


class _OfShard(_OfMap):
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


class SettledFrame(NamedTuple):
    """What a channel, or a shard of one, has settled of a frame in hindsight.

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


class SettledFrames(_Strict):
    """Settled frames of a worker's channels, in a few arrays: they may be many.

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
            raise PydanticCustomError("settled", "of some frames there is more than of others")
        if any((vector < 0).any() for vector in (self.channels, self.before, self.lags, *counts)):
            raise PydanticCustomError("settled", "a number is negative")
        if (self.channels >= 2**16).any() or (self.best < -1).any():
            raise PydanticCustomError("settled", "there is no such channel or place")
        if not np.isfinite(self.scores).all():
            raise PydanticCustomError("settled", "a score is not finite")
        if ((self.too_fast < 0) | (self.too_fast > 1)).any():
            raise PydanticCustomError("settled", "a posterior is not between 0 and 1")
        for count, vector in zip(counts, (self.places, self.evidence), strict=True):
            if int(count.sum(dtype=np.int64)) != len(vector):
                raise PydanticCustomError("settled", "places or evidence are not as many as said")
        return self

    @classmethod
    def of(cls, sequence: int, frames: Sequence[SettledFrame]) -> Self | None:
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

    def frames(self, sequence: int) -> Iterator[SettledFrame]:
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
            yield SettledFrame(channel, sequence - before, lag, candidate)


class CandidatesMessage(_OfShard):
    """The candidates of a worker's channels: together, for each message costs the fuser a wake-up.

    Attributes:
        rule: how they were made.
        candidates: one of each channel.
        settled: frames that the channels have settled since the message before; none: no frame.
    """

    rule: Rule
    candidates: tuple[ChannelCandidate, ...] = Field(min_length=1)
    settled: SettledFrames | None = None


class FinishedMessage(_OfShard):
    """What a worker's channels settle at the end of a stream: all frames that are left.

    It goes with the end's header, and is the only end that has a payload.

    Attributes:
        rule: how candidates were made.
        channels: of the worker.
        settled: the frames; none: all had been settled.
    """

    rule: Rule
    channels: tuple[Channel, ...] = Field(min_length=1)
    settled: SettledFrames | None = None


class ChannelSummary(_Strict):
    """What a channel's shards need of one of them, as part of a message."""

    channel: Channel
    summary: NumberVector


class BordersMessage(_OfShard):
    """What the shards of a worker tell those beside them of a frame.

    Attributes:
        summaries: one of each channel.
    """

    summaries: tuple[ChannelSummary, ...] = Field(min_length=1)


_OF_MATCH = tuple(field.name for field in fields(Match))


class MatchMessage(_OfMap):
    """The match of a frame.

    Attributes:
        place: index of the place, or -1 where there is no answer.
        score: the higher the more certain.
        missing: channels that did not answer in time.
        probability: that the vehicle is within the fuser's tolerance of the place; none where the
            rule does not tell.
        known: whether that is at least the precision asked for, and the vehicle not too fast.
        too_fast: whether the vehicle moves faster than the map resolves; only some rules tell.
        forgotten: whether the stream was begun anew in its midst, and nobody remembered enough.
        pose: of the place, x and y in metres and yaw in radians, where the map has poses.
    """

    place: int = Field(ge=-1, lt=2**31)
    score: FiniteFloat
    missing: tuple[Channel, ...] = ()
    probability: float | None = Field(None, ge=0, le=1)
    known: bool | None = None
    too_fast: bool = False
    forgotten: bool = False
    pose: Pose | None = None

    @classmethod
    def of(cls, match: Match, **more: Any) -> Self:
        """Make the message of a match; ``more`` is what else the message has."""
        return cls(**vars(match), **more)

    @property
    def match(self) -> Match:
        """The match."""
        told = {name: getattr(self, name) for name in _OF_MATCH}
        return Match(**told | {"pose": None if self.pose is None else PlacePose(*self.pose)})


class SmoothedMessage(MatchMessage):
    """The smoothed match of a frame: what ``MatchMessage`` has, given frames after it.

    Attributes:
        lag: how many.
    """

    lag: int = Field(ge=0, lt=2**31)


class MomentsMessage(Message):
    """What the frames of a stream were like up to one, for a featurizer that goes on with it.

    Attributes:
        frames: how many.
        sums: (2, D) float64, of raw features at unit length, and of their squares.
    """

    frames: FiniteFloat = Field(gt=0)
    sums: Sums


class HistoryQuery(Message):
    """Asks for the messages of frames ``first`` to ``end`` - 1 of a stream."""

    stream: str = Field(min_length=1, max_length=64)
    first: int = Field(ge=0, lt=2**48)
    end: int = Field(ge=0, le=2**49)


class OdometryMessage(Message):
    """How far the vehicle has travelled since any start of its own; it needs no header."""

    metres: Metres


class StatsMessage(Message):
    """What a service has counted since it started, and how far it is.

    Attributes:
        service: its name.
        counts: by what is counted.
        stream: of the newest frame that it has answered; none if it has answered none.
        sequence: of that frame; at the end of the stream, the number of its frames.
        channels: of the map, where the service awaits them all.
        map: digest of the service's map; none if it has none.
    """

    service: str = Field(max_length=64)
    counts: dict[str, int]
    stream: str | None = Field(None, max_length=64)
    sequence: int | None = Field(None, ge=0, lt=2**48)
    channels: int | None = Field(None, ge=1, lt=2**16)
    map: Digest | None = None
