"""Test doubles of the bus for tests of services."""

from collections.abc import Callable

from placefield.bus.inbox import Received
from placefield.bus.message import Header, Message
from placefield.bus.publishing import Publisher
from placefield.bus.replay_cache import Fetched
from placefield_services.background_query import NotYet


class RecordingPublisher(Publisher):
    """Records the published messages of one kind."""

    def __init__(self, kind: type[Message], end: type[Message] | None = None) -> None:
        """Record messages of ``kind``; the end of a stream has a payload of ``end``, or none."""
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
    """Handle a message, and repeat while an answer to a query has not come."""
    while True:
        try:
            return handle()
        except NotYet:
            pass


class PeerCache:
    """The replay cache of another service; empty at first."""

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
