"""What travels on the bus, but for what channel workers say; see ``message`` for what all have."""

from dataclasses import fields
from typing import Any, Literal, Self

from pydantic import Field, FiniteFloat

from placefield.bus.message import Channel, Digest, Message, Metres, OfMap
from placefield.bus.wire import FloatVector, Image, Sums
from placefield.fusion.match import Match
from placefield.pose import Pose as PlacePose

Pose = tuple[FiniteFloat, FiniteFloat, FiniteFloat]


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


class MissingObservationMessage(Message):
    """Why a frame goes on as one not seen: no image can be made of it, or it shows nothing."""

    reason: Literal["unreadable", "blank"]


_OF_MATCH = tuple(field.name for field in fields(Match))


class MatchMessage(OfMap):
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
        values = {name: getattr(self, name) for name in _OF_MATCH}
        return Match(**values | {"pose": None if self.pose is None else PlacePose(*self.pose)})


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


class CacheQuery(Message):
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
