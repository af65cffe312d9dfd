"""The messages on the bus, except those of channel workers; ``message`` has their base."""

from dataclasses import fields
from typing import Any, Literal, Self

from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from placefield.bus.message import Channel, Digest, Message, Metres, OfMap
from placefield.bus.wire import Descriptor, FloatVector, Image, Sums
from placefield.features.calibration import Calibration
from placefield.fusion.match import Match
from placefield.pose import Pose as PlacePose

Pose = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


class FrameMessage(Message):
    """A frame: an image or a given descriptor, with the odometry reading, if there is one.

    Attributes:
        image: encoded, as bytes, or pixels; None: there is a descriptor.
        descriptor: (D,) float16 or float32, finite; None: there is an image.
        odometry_m: the odometry reading, metres.
        calibration: of the camera that took the image; None if it is not known.
    """

    image: Image | None = None
    descriptor: Descriptor | None = None
    odometry_m: Metres | None = None
    calibration: Calibration | None = None

    @model_validator(mode="after")
    def _check_content(self) -> Self:
        if (self.image is None) == (self.descriptor is None):
            raise PydanticCustomError("content", "a frame is an image or a descriptor")
        return self


class RawFeatureMessage(Message):
    """The raw feature of a frame, or of a part of the feature, of a describer.

    Attributes:
        model: fingerprint of the model whose feature it is.
        part: number of the part of the feature.
        raw: (D,) of the part, finite; None: the describer could not describe the frame.
    """

    model: str = Field(max_length=64)
    part: int = Field(0, ge=0, lt=2**16)
    raw: FloatVector | None


class FeatureMessage(Message):
    """The descriptor of a frame.

    Attributes:
        model: fingerprint of the model that made the descriptor.
        descriptor: (N,) of length 1, or the raw feature (D,) where a drive is explored; None: a
            missing observation.
        odometry_m: the odometry reading of the frame, metres.
        forgotten: whether no replay cache had enough of the stream for the featurizer to resume it.
    """

    model: str = Field(max_length=64)
    descriptor: FloatVector | None
    odometry_m: Metres | None = None
    forgotten: bool = False


class MissingObservationMessage(Message):
    """Why a frame is a missing observation: it cannot be read, or is blank."""

    reason: Literal["unreadable", "blank"]


_OF_MATCH = tuple(field.name for field in fields(Match))


class MatchMessage(OfMap):
    """The match of a frame.

    Attributes:
        place: index of the place, or -1 where there is no answer.
        score: the higher, the more certain.
        missing: channels that did not answer in time.
        probability: that the vehicle is within the fuser's tolerance of the place; None if the rule
            does not estimate it.
        known: whether the probability reaches the precision asked for, and the vehicle is not too
            fast.
        too_fast: whether the vehicle moves faster than the map resolves; only ``filter`` says so.
        forgotten: whether a service resumed the stream, and no replay cache had enough of it.
        pose: of the place, x and y in metres and yaw in radians, if the map has poses.
        new: probability that the frame shows no earlier place; only where a drive is explored. Then
            ``place`` is the number of an earlier frame of the stream.
    """

    place: int = Field(ge=-1, lt=2**31)
    score: FiniteFloat
    missing: tuple[Channel, ...] = ()
    probability: float | None = Field(None, ge=0, le=1)
    known: bool | None = None
    too_fast: bool = False
    forgotten: bool = False
    pose: Pose | None = None
    new: float | None = Field(None, ge=0, le=1)

    @classmethod
    def of(cls, match: Match, **more: Any) -> Self:
        """Make the message of a match; ``more`` has the fields that a match has not."""
        return cls(**vars(match), **more)

    @property
    def match(self) -> Match:
        """The match."""
        values = {name: getattr(self, name) for name in _OF_MATCH}
        return Match(**values | {"pose": None if self.pose is None else PlacePose(*self.pose)})


class SmoothedMessage(MatchMessage):
    """The smoothed match of a frame: a match that also uses later frames.

    Attributes:
        lag: how many later frames it uses.
    """

    lag: int = Field(ge=0, lt=2**31)


class MomentsMessage(Message):
    """The moments of a stream's features up to a frame, for a featurizer that resumes the stream.

    Attributes:
        frames: how many frames were summed.
        sums: (2, D) float64, sums of raw features of length 1, and of their squares.
    """

    frames: FiniteFloat = Field(gt=0)
    sums: Sums


class CacheQuery(Message):
    """A query to replay caches for the messages of frames ``first`` to ``end`` - 1 of a stream."""

    stream: str = Field(min_length=1, max_length=64)
    first: int = Field(ge=0, lt=2**48)
    end: int = Field(ge=0, le=2**49)


class OdometryMessage(Message):
    """How far the vehicle has travelled, metres since any start; the message has no header."""

    metres: Metres


class StatsMessage(Message):
    """The counts of a service since it started, and its newest answer.

    Attributes:
        service: its name.
        counts: each count by its name.
        stream: of the newest frame that the service has answered; None if there is none.
        sequence: of that frame; at the end of the stream, the number of its frames.
        channels: how many channels the map has, if the service needs them all.
        map: digest of the service's map; None if it has none.
    """

    service: str = Field(max_length=64)
    counts: dict[str, int]
    stream: str | None = Field(None, max_length=64)
    sequence: int | None = Field(None, ge=0, lt=2**48)
    channels: int | None = Field(None, ge=1, lt=2**16)
    map: Digest | None = None
