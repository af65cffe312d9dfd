"""Publishes messages on a key: each at once, or several together.

Each sample on the bus wakes up every process that receives it. While messages wait in the inbox of
a service, its answers may wait, too: those that are ready at about the same time travel together.
"""

import time
from collections.abc import Sequence

import zenoh

from placefield.bus.bundle import MOST_TOGETHER, WithHeader, pack
from placefield.bus.message import Header, Message

TOGETHER_S = 0.02
"""How long messages are gathered, seconds."""


class Publisher:
    """Publishes messages on one key. It waits, and drops nothing, when the link is congested."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher

    def put(self, header: Header, message: Message | None = None) -> None:
        """Send a message with its header; no message at the end of a stream."""
        self.send(header, message.encode() if message else b"")

    def send(self, header: Header, payload: bytes) -> None:
        """Send an encoded message."""
        self.send_together([(header, payload)])

    def send_together(self, messages: Sequence[WithHeader]) -> None:
        """Send encoded messages, at most ``MOST_TOGETHER``, in one sample."""
        attachment, payload = pack(messages)
        self._publisher.put(payload, attachment=attachment)


class Outbox:
    """Gathers the messages of a service for a short time; one thread uses it.

    Messages of live streams are sent at once.
    """

    def __init__(self) -> None:
        self._gathered: dict[Publisher, list[WithHeader]] = {}
        self._since = 0.0

    def begin(self) -> None:
        """Say that the service begins to answer what it has received."""
        if not self._gathered:
            self._since = time.monotonic()

    def add(self, publisher: Publisher, message: WithHeader) -> None:
        """Gather a message; send all that are gathered if it is time to."""
        gathered = self._gathered.setdefault(publisher, [])
        gathered.append(message)
        if message[0].live or self.is_due or len(gathered) == MOST_TOGETHER:
            self.send_all()

    def replace(self, publisher: Publisher, message: WithHeader) -> None:
        """Gather a message in place of the publisher's last one.

        It is sent with the next message of another publisher, and before that.
        """
        self._gathered[publisher] = [message]

    @property
    def is_due(self) -> bool:
        """Whether messages have been gathered for long enough."""
        return time.monotonic() >= self._since + TOGETHER_S

    def send_all(self) -> None:
        """Send all gathered messages, in the order in which their publishers were used first."""
        gathered, self._gathered = self._gathered, {}
        for publisher, messages in gathered.items():
            publisher.send_together(messages)
        self._since = time.monotonic()


class GatheringPublisher(Publisher):
    """Publishes messages on one key together with others, by way of an outbox."""

    def __init__(self, publisher: zenoh.Publisher, outbox: Outbox) -> None:
        super().__init__(publisher)
        self._outbox = outbox

    def send(self, header: Header, payload: bytes) -> None:
        """Gather an encoded message."""
        self._outbox.add(self, (header, payload))


class NewestPublisher(GatheringPublisher):
    """Publishes only the newest of several messages, which stands for those before it.

    The message is sent before the messages that follow it.
    """

    def send(self, header: Header, payload: bytes) -> None:
        """Gather an encoded message in place of the last one."""
        self._outbox.replace(self, (header, payload))
