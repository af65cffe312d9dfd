"""Stands for the bus where a service is tested without one."""

from collections.abc import Callable

from placefield.bus.inbox import Received
from placefield.bus.message import Header, Message
from placefield.bus.replay_cache import Fetched
from placefield.bus.session import Publisher
from placefield_services.background_query import NotYet


class RecordingPublisher(Publisher):
    """Keeps what is published, of one kind of message."""

    def __init__(self, kind: type[Message], end: type[Message] | None = None) -> None:
        """Take the kind, and that of the end of a stream, where that has a payload."""
        self._kind, self._end = kind, end
        self.sent: list[tuple[Header, Message | None]] = []

    def send(self, header: Header, payload: bytes) -> None:
        kind = self._end if header.end else self._kind
        assert kind is not None or not payload
        self.sent.append((header, kind.decode(payload) if kind is not None and payload else None))

    @property
    def sequences(self) -> list[int]:
        return [header.sequence for header, _ in self.sent]


def at_last(handle: Callable[[], None]) -> None:
    """Handle a message, again and again while what others know of it has not come."""
    while True:
        try:
            return handle()
        except NotYet:
            pass


class PeerCache:
    """What others remember of a stream; nothing at first."""

    def __init__(self) -> None:
        self.kept: dict[int, tuple[Header, bytes]] = {}

    def fetch(self, stream: str, first: int, end: int) -> Fetched:
        return {
            sequence: (about, payload)
            for sequence, (about, payload) in self.kept.items()
            if about.stream == stream and first <= sequence < end
        }


def header(
    sequence: int, *, stream: str = "s", live: bool = False, end: bool = False, oldest: int = 0
) -> Header:
    return Header(
        stream=stream, sequence=sequence, stamp_ns=sequence, live=live, end=end, oldest=oldest
    )


def received(key: str, about: Header, message: Message | bytes = b"") -> Received:
    payload = message if isinstance(message, bytes) else message.encode()
    return Received(key, about, payload)
