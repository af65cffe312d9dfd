"""Follows streams: which one is on, what is missing of it, what came twice."""

from collections import Counter, deque
from enum import Enum, auto

from placefield.bus.messages import Header

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
        self._stream: str | None = None
        self._left: deque[str] = deque(maxlen=_REMEMBERED)

    def enter(self, stream: str) -> Arrival:
        """Say what a message of this stream is."""
        if stream == self._stream:
            return Arrival.SAME_STREAM
        if stream in self._left:
            self._counts["stale"] += 1
            return Arrival.DROPPED
        if self._stream is not None:
            self._left.append(self._stream)
        self._stream = stream
        self._counts["streams"] += 1
        return Arrival.NEW_STREAM


class StreamFollower:
    """Follows the frames of one stream after the other, each frame once.

    Counts, besides what ``StreamSwitch`` counts, ``gaps`` (frames that did not come) and
    ``duplicate`` messages.
    """

    def __init__(self, counts: Counter[str]) -> None:
        self._counts = counts
        self._switch = StreamSwitch(counts)
        self._next = 0

    def follow(self, header: Header) -> Arrival:
        """Say what the message with this header is."""
        arrival = self._switch.enter(header.stream)
        if arrival is Arrival.DROPPED:
            return arrival
        expected = header.sequence if arrival is Arrival.NEW_STREAM else self._next
        if header.sequence < expected:
            self._counts["duplicate"] += 1
            return Arrival.DROPPED
        self._counts["gaps"] += header.sequence - expected
        self._next = header.sequence + 1
        return arrival
