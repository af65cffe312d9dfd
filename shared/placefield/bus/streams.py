"""Follows streams: which one is on, what is missing of it, what came twice."""

from collections import Counter, deque
from collections.abc import Callable
from enum import Enum, auto

from placefield.bus.message import Header
from placefield.errors import MessageError

_REMEMBERED = 16  # streams that were left


class Arrival(Enum):
    """What a message is to the one who follows the stream."""

    NEW_STREAM = auto()  # the first message of it
    SAME_STREAM = auto()
    DROPPED = auto()


class StreamSwitch:
    """Knows the stream that is on; one that was left is never entered again.

    Counts ``streams``, and ``stale`` messages of streams that were left.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self.stream: str | None = None
        """The stream that is on."""
        self._live = False
        self._left: deque[str] = deque(maxlen=_REMEMBERED)

    def enter(self, header: Header) -> Arrival:
        """Say what the message with this header is.

        Raises:
            MessageError: it is of the stream that is on, but live where that is not, or not live
                where it is: all frames of a stream are one or the other.
        """
        stream = header.stream
        if stream == self.stream:
            if header.live != self._live:
                raise MessageError("a stream is live or is not; this message says otherwise")
            return Arrival.SAME_STREAM
        if stream in self._left:
            self._counts["stale"] += 1
            return Arrival.DROPPED
        if self.stream is not None:
            self._left.append(self.stream)
        self.stream, self._live = stream, header.live
        self._counts["streams"] += 1
        return Arrival.NEW_STREAM

    def begins(self, header: Header) -> bool:
        """Whether the message with this header is the first of its stream."""
        return header.stream != self.stream and not self.has_left(header.stream)

    def has_left(self, stream: str) -> bool:
        """Whether this is a stream that was left."""
        return stream in self._left


class Turn(Enum):
    """What a message is to the one who takes the frames of a stream in order."""

    NEXT = auto()
    AFTER_GAP = auto()  # there are frames before it that have not come
    REPEATED = auto()
    DROPPED = auto()  # of a stream that was left


class StreamFollower:
    """Follows the frames of one stream after the other, each frame once and in order.

    Counts, besides what ``StreamSwitch`` counts, ``gaps`` (frames that were done without) and
    ``repeated`` messages.
    """

    def __init__(self, counts: Counter[str], join: Callable[[Header], int]) -> None:
        """Call ``join`` with the first message of a stream; it returns the frame to begin with."""
        self._counts = counts
        self._join = join
        self._switch = StreamSwitch(counts)
        self.next = 0
        """The number of the frame whose turn it is."""

    @property
    def stream(self) -> str | None:
        """The stream that is on."""
        return self._switch.stream

    def begins(self, header: Header) -> bool:
        """Whether the message with this header is the first of its stream."""
        return self._switch.begins(header)

    def follow(self, header: Header) -> Turn:
        """Say what the message with this header is; if its turn has come, it is over.

        Raises:
            MessageError: see ``StreamSwitch``.
        """
        arrival = self._switch.enter(header)
        if arrival is Arrival.DROPPED:
            return Turn.DROPPED
        if arrival is Arrival.NEW_STREAM:
            self.next = header.sequence
            self.next = self._join(header)
        if header.sequence < self.next:
            self._counts["repeated"] += 1
            return Turn.REPEATED
        if header.sequence > self.next:
            return Turn.AFTER_GAP
        self.next += 1
        return Turn.NEXT

    def skip_to(self, sequence: int, gaps: int | None = None) -> None:
        """Take this frame before its turn; so many before it are done without, if not all."""
        self._counts["gaps"] += sequence - self.next if gaps is None else gaps
        self.next = sequence + 1
