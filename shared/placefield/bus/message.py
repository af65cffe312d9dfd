"""The base of all messages on the bus: msgpack with a schema version.

Every data message has a ``Header`` in its attachment; the payload is another model. Decoding checks
every field: a malformed message raises ``MessageError``.
"""

from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from placefield.bus.wire import pack, unpack
from placefield.errors import MessageError, OtherMapError

MAX_BYTES = 128 * 2**20
"""No message is larger than this."""

Channel = Annotated[int, Field(ge=0, lt=2**16)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{16}$")]
Metres = Annotated[FiniteFloat, Field(ge=0)]
"""An odometer's reading: metres travelled since any start. If it falls, the odometer restarted."""


class Strict(BaseModel):
    """A model that refuses unknown fields and values of another type."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, arbitrary_types_allowed=True
    )


class Message(Strict):
    """Root of all messages."""

    version: Literal[3] = 3  # of the schema

    def encode(self) -> bytes:
        """Return the message as msgpack."""
        return pack(vars(self))

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """Read a message back.

        Raises:
            MessageError: the data are too large, or no message of this kind and version.
        """
        if len(data) > MAX_BYTES:
            raise MessageError(f"{cls.__name__}: {len(data)} bytes, more than {MAX_BYTES}")
        try:
            message = cls.model_validate(unpack(data))
        except ValidationError as error:
            first = error.errors(include_url=False, include_context=False, include_input=False)[0]
            where = ".".join(str(part) for part in first["loc"])
            # An untrusted client may have named the field; quoted and cut, it is one log line.
            raise MessageError(f"{cls.__name__}: {where!r:.80}: {first['msg']}") from None
        except Exception as error:  # msgpack raises a dozen kinds, RecursionError among them
            why = str(error) or type(error).__name__
            raise MessageError(f"{cls.__name__}: no msgpack: {why}") from None
        if "version" not in message.model_fields_set:
            raise MessageError(f"{cls.__name__}: has no version")
        return message


class Header(Message):
    """The stream and the frame of a message; it travels as the attachment.

    Attributes:
        stream: name of the stream, new for every replay.
        sequence: number of the frame in its stream, from 0, with no gaps at the source.
        stamp_ns: when the frame was recorded, by the clock of its source, nanoseconds.
        live: whether old frames may be dropped for new ones.
        oldest: number of the oldest frame that its source awaits an answer to, in a lossless
            stream; not later than this frame.
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
            raise PydanticCustomError("oldest", "the oldest awaited frame is later than this frame")
        return self

    def of_frame(self, sequence: int) -> "Header":
        """Return the header of another frame of the stream, not of its end."""
        oldest = min(self.oldest, sequence)
        return self.model_copy(update={"sequence": sequence, "oldest": oldest, "end": False})


class OfMap(Message):
    """Root of messages that name places; they also name the map of the places.

    Attributes:
        map: digest of the map, see ``placefield.maps.map.Map``.
    """

    map: Digest

    def check_map(self, digest: str) -> None:
        """Refuse a message of another map than the one with this digest.

        Raises:
            OtherMapError: the message is of another map.
        """
        if self.map != digest:
            raise OtherMapError(
                f"{type(self).__name__} of map {self.map}, not {digest}; give all services one map"
            )
