"""Follows streams: which stream is current, which frames are missing, which came twice."""

from collections import Counter, deque
from collections.abc import Callable
from enum import Enum, auto

from placefield.bus.message import Header
from placefield.errors import MessageError

_REMEMBERED = 16  # streams that were left


class Arrival(Enum):
    """How a message relates to the current stream."""

    NEW_STREAM = auto()  # the first message of a new stream
    SAME_STREAM = auto()
    DROPPED = auto()  # of a stream that was left


class StreamSwitch:
    """Tracks the current stream; a stream that was left is never entered again.

    Counts ``streams``, and as ``stale`` the messages of streams that were left.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self.stream: str | None = None
        """Name of the current stream."""
        self._live = False
        self._left: deque[str] = deque(maxlen=_REMEMBERED)

    def enter(self, header: Header) -> Arrival:
        """Return how the message with this header relates to the current stream.

        Raises:
            MessageError: the message is of the current stream, but one is live and the other not.
        """
        stream = header.stream
        if stream == self.stream:
            if header.live != self._live:
                raise MessageError("the message is live and its stream is not, or the reverse")
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
        """Return whether the message with this header is the first of its stream."""
        return header.stream != self.stream and not self.has_left(header.stream)

    def has_left(self, stream: str) -> bool:
        """Return whether this stream was left."""
        return stream in self._left


class Turn(Enum):
    """Where a message is in the order of its stream's frames."""

    NEXT = auto()  # the frame that is due
    AFTER_GAP = auto()  # earlier frames have not come
    REPEATED = auto()  # an earlier frame again
    DROPPED = auto()  # of a stream that was left


class StreamFollower:
    """Follows the frames of one stream after the other, each frame once and in order.

    Counts ``gaps`` (skipped frames) and ``repeated`` messages, besides the counts of
    ``StreamSwitch``.
    """

    def __init__(self, counts: Counter[str], join: Callable[[Header], int]) -> None:
        """Call ``join`` with the first header of a stream; it returns the frame to begin with."""
        self._counts = counts
        self._join = join
        self._switch = StreamSwitch(counts)
        self.next = 0
        """The number of the frame that is due."""

    @property
    def stream(self) -> str | None:
        """Name of the current stream."""
        return self._switch.stream

    def begins(self, header: Header) -> bool:
        """Return whether the message with this header is the first of its stream."""
        return self._switch.begins(header)

    def awaits(self, header: Header) -> bool:
        """Return whether the message is of the current stream, and of a frame that has not come."""
        return header.stream == self.stream and header.sequence >= self.next

    def follow(self, header: Header) -> Turn:
        """Return where the message with this header is in order; if it is due, move on by one.

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
        """Skip to the frame after this one, and count ``gaps`` frames as skipped.

        Args:
            sequence: number of the frame that is handled out of order.
            gaps: how many frames to count; None: all frames from the one that was due.
        """
        self._counts["gaps"] += sequence - self.next if gaps is None else gaps
        self.next = sequence + 1
