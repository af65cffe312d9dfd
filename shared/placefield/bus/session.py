"""A session on the bus, by way of which all messages go: only this package speaks Zenoh."""

import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

from placefield.bus.bundle import unpack_all
from placefield.bus.inbox import Received
from placefield.bus.keys import EVERY_TOKEN, Keys, run_of
from placefield.bus.message import MAX_BYTES, Header, Message
from placefield.bus.publishing import GatheringPublisher, NewestPublisher, Outbox, Publisher
from placefield.errors import BusError, MessageError

log = logging.getLogger(__name__)

MOST_TOKENS = 4096
"""The most tokens of a run that are kept; any more come from an untrusted client."""

LONGEST_STATS = 2**16
"""The most bytes of a message in which a service reports its counts."""

_LOG_EVERY_S = 10.0
_ALIVE_S = 2.0


class Bus:
    """A session: publishers, subscriptions and liveliness tokens."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: list[Any] = []  # Zenoh undeclares an object that has no reference left
        self._last_logged = -_LOG_EVERY_S
        self.outbox = Outbox()
        """The messages of the publishers that gather."""

    @property
    def identity(self) -> str:
        """The Zenoh identity of this session."""
        return str(self._session.zid())

    @property
    def connected(self) -> bool:
        """Whether the session has a link to a router now."""
        return bool(self._session.info.routers_zid())

    def publisher(self, key: str) -> Publisher:
        """Declare a publisher of a key."""
        return Publisher(self._declare_publisher(key))

    def gathering_publisher(self, key: str) -> Publisher:
        """Declare a publisher of a key whose messages travel together, by way of ``outbox``."""
        return GatheringPublisher(self._declare_publisher(key), self.outbox)

    def newest_publisher(self, key: str) -> Publisher:
        """Declare a publisher of a key of which only the newest message in ``outbox`` is sent."""
        return NewestPublisher(self._declare_publisher(key), self.outbox)

    def _declare_publisher(self, key: str) -> zenoh.Publisher:
        return self._session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )

    def put(self, key: str, message: Message) -> None:
        """Send one message that belongs to no stream; it is dropped when the link is congested."""
        self._session.put(key, message.encode())

    def put_raw(self, key: str, payload: bytes, attachment: bytes) -> None:
        """Send bytes that are no Placefield message; dropped when the link is congested."""
        self._session.put(key, payload, attachment=attachment)

    def subscribe(
        self,
        key: str,
        receive: Callable[[Received], None],
        counts: Counter[str],
        *,
        ends_empty: bool = True,
        in_turn: bool = False,
    ) -> None:
        """Call ``receive`` for each message on a key, on a thread of the bus, which must not wait.

        Each key has its own thread. With ``in_turn`` several keys share one thread, so that their
        messages are received in the order in which they were sent.

        A message without a valid header is dropped and counted as ``malformed``; a bundle is as a
        whole. So is a message that was put on many keys at once. With ``ends_empty`` so is the end
        of a stream that has a payload.
        """

        def call(sample: zenoh.Sample) -> None:
            key, attachment = str(sample.key_expr), sample.attachment
            with self._counting_malformed(key, counts):
                _check_key(key)
                header = attachment.to_bytes() if attachment else b""
                for message in unpack_all(header, sample.payload.to_bytes()):
                    with self._counting_malformed(key, counts):
                        receive(_received(key, *message, ends_empty=ends_empty))

        handler = zenoh.handlers.Callback(call, indirect=not in_turn)
        self._declared.append(self._session.declare_subscriber(key, handler))

    @contextmanager
    def _counting_malformed(self, key: str, counts: Counter[str]) -> Iterator[None]:
        try:
            yield
        except MessageError as error:
            counts["malformed"] += 1
            self.log_dropped(key, error)

    def subscribe_raw(self, key: str, receive: Callable[[str, bytes], None]) -> None:
        """Call ``receive(key, payload)`` for each message on a key, on the bus's thread."""

        def call(sample: zenoh.Sample) -> None:
            try:
                _check_key(str(sample.key_expr))
            except MessageError as error:
                self.log_dropped(str(sample.key_expr), error)
                return
            receive(str(sample.key_expr), sample.payload.to_bytes())

        self._declared.append(self._session.declare_subscriber(key, call))

    def answer(
        self, key: str, reply: Callable[[str, bytes], Iterable[tuple[bytes, bytes]]]
    ) -> None:
        """Answer queries for a key: ``reply(key, payload)`` yields payloads and attachments.

        ``reply`` is called on the bus's thread, which must not wait. If it raises ``MessageError``,
        the query gets no answer.
        """

        def call(query: zenoh.Query) -> None:
            with query:
                try:
                    if query.payload is not None and len(query.payload) > MAX_BYTES:
                        raise MessageError(f"{len(query.payload)} bytes, more than {MAX_BYTES}")
                    asked = query.payload.to_bytes() if query.payload is not None else b""
                    for payload, attachment in reply(str(query.key_expr), asked):
                        query.reply(query.key_expr, payload, attachment=attachment)
                except MessageError as error:
                    self.log_dropped(str(query.key_expr), error)

        self._declared.append(self._session.declare_queryable(key, call))

    def ask(
        self, key: str, payload: bytes = b"", *, timeout_s: float
    ) -> Iterator[tuple[bytes, bytes]]:
        """Query a key; yield the payloads and attachments of all replies that come in time."""
        try:
            replies = self._session.get(
                key,
                payload=payload,
                timeout=timeout_s,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError as error:
            log.warning("the query to %s failed: %s", key, error)
            return
        end = time.monotonic() + timeout_s
        for reply in replies:
            if time.monotonic() > end + timeout_s:  # replies could go on for ever
                return
            if reply.ok and len(reply.ok.payload) <= MAX_BYTES:
                attachment = reply.ok.attachment
                yield reply.ok.payload.to_bytes(), attachment.to_bytes() if attachment else b""

    @contextmanager
    def scoped(self) -> Iterator[None]:
        """Undeclare at the end of the block everything that is declared inside it."""
        before = len(self._declared)
        try:
            yield
        finally:
            for declared in self._declared[before:]:
                declared.undeclare()
            del self._declared[before:]

    def log_dropped(self, key: str, error: Exception) -> None:
        """Log that a message was dropped, at most once in ten seconds: there may be many."""
        now = time.monotonic()
        if now - self._last_logged >= _LOG_EVERY_S:
            self._last_logged = now
            log.warning("dropped a message on %.200r: %s", key, error)

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token, which lives as long as this session."""
        self._declared.append(self._session.liveliness().declare_token(key))

    @contextmanager
    def sole(self, keys: Keys, service: str, identity: str) -> Iterator[None]:
        """Hold the token of a service of which a run has only one, for the length of the block.

        The token is declared before the search for others, so that two services that start together
        find each other; then both give up.

        Raises:
            BusError: the run has this service already.
        """
        own = keys.alive(service, identity)
        token = self._session.liveliness().declare_token(own)
        try:
            if self.alive(keys.all_alive(service)) - {own}:
                raise BusError(
                    f"run {keys.run!r} has a {service} already; "
                    "stop that one, or choose another name with --run"
                )
            yield
        finally:
            token.undeclare()  # type: ignore[no-untyped-call]

    def alive(self, key: str) -> set[str]:
        """Return the liveliness tokens that exist now on a key."""
        found: set[str] = set()
        is_over = threading.Event()

        def call(reply: zenoh.Reply) -> None:
            if reply.ok and len(found) < MOST_TOKENS:
                found.add(str(reply.ok.key_expr))

        # A Zenoh channel would stop the whole session when it is full of replies.
        handler = zenoh.handlers.Callback(call, is_over.set)
        self._session.liveliness().get(key, handler, timeout=_ALIVE_S)
        is_over.wait(_ALIVE_S)
        return set(found)

    def runs(self) -> set[str]:
        """Return the names of the runs that have a live service."""
        return {run_of(token) for token in self.alive(EVERY_TOKEN)}

    def watch_alive(self, key: str, change: Callable[[str, bool], None]) -> None:
        """Call ``change(key, is_alive)`` for each token of a key, existing tokens included."""

        def call(sample: zenoh.Sample) -> None:
            change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._declared.append(
            self._session.liveliness().declare_subscriber(key, call, history=True)
        )


def _received(key: str, header: Header, payload: bytes, *, ends_empty: bool) -> Received:
    """Return a received message.

    Raises:
        MessageError: it is the end of a stream, has a payload, and ``ends_empty``.
    """
    if ends_empty and header.end and payload:
        raise MessageError("the end of a stream has no payload")
    return Received(key, header, payload)


def _check_key(key: str) -> None:
    """Refuse a message that was put on all keys of a pattern: it belongs to no run.

    Raises:
        MessageError: the key is a pattern.
    """
    if "*" in key:
        raise MessageError("the message was put on many keys at once")
