"""Stands for the bus where a service is tested without one."""

from placefield.bus.inbox import Received
from placefield.bus.messages import Header, Message
from placefield.bus.session import Publisher


class RecordingPublisher(Publisher):
    """Keeps what is published."""

    def __init__(self) -> None:
        self.sent: list[tuple[Header, Message | None]] = []

    def put(self, header: Header, message: Message | None = None) -> None:
        self.sent.append((header, message))

    @property
    def sequences(self) -> list[int]:
        return [header.sequence for header, _ in self.sent]


def header(sequence: int, *, stream: str = "s", live: bool = False, end: bool = False) -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=sequence, live=live, end=end)


def received(key: str, about: Header, message: Message | bytes = b"") -> Received:
    payload = message if isinstance(message, bytes) else message.encode()
    return Received(key, about, payload)
