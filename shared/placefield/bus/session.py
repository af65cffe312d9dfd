"""A session on the bus: the one place that speaks Zenoh."""

import itertools
import logging
import random
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from placefield.bus.credentials import access_control
from placefield.bus.inbox import Received
from placefield.bus.keys import EVERY_TOKEN, Keys, run_of
from placefield.bus.message import MAX_BYTES, Header, Message
from placefield.bus.settings import (
    VIEWERS,
    client_settings,
    is_local,
    router_settings,
    zenoh_config,
)
from placefield.config import BusConfig
from placefield.errors import BusError, MessageError

log = logging.getLogger(__name__)

MOST_TOKENS = 4096
"""Of a run, that are known of: the rest are a stranger's."""

LONGEST_STATS = 2**16
"""Bytes of a message in which a service tells what it has counted."""

_LOG_EVERY_S = 10.0
_ALIVE_S = 2.0
_ATTEMPT_S = 0.5


class Publisher:
    """Publishes messages on one key. Waits rather than drops when the way is full."""

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self._publisher = publisher

    def put(self, header: Header, message: Message | None = None) -> None:
        """Send a message with its header; no message at the end of a stream."""
        self.send(header, message.encode() if message else b"")

    def send(self, header: Header, payload: bytes) -> None:
        """Send a message that is encoded already."""
        self._publisher.put(payload, attachment=header.encode())


class Bus:
    """A session: publishers, subscriptions and liveliness tokens."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: list[Any] = []  # Zenoh undeclares what nobody holds
        self._last_logged = -_LOG_EVERY_S

    @property
    def identity(self) -> str:
        """Of this session, as Zenoh tells it to others."""
        return str(self._session.zid())

    def publisher(self, key: str) -> Publisher:
        """Declare a publisher of a key."""
        return Publisher(
            self._session.declare_publisher(key, congestion_control=zenoh.CongestionControl.BLOCK)
        )

    def put(self, key: str, message: Message) -> None:
        """Send one message that belongs to no stream; dropped when the way is full."""
        self._session.put(key, message.encode())

    def put_raw(self, key: str, payload: bytes, attachment: bytes) -> None:
        """Send what is no message of ours; dropped when the way is full."""
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
        """Call ``receive`` for what comes on a key, on the bus's thread, which must not wait.

        That is a thread of the key's own, unless what comes on several keys is to be taken in the
        order in which it was sent (``in_turn``).

        What has no good header is dropped and counted as ``malformed``; and so is what was put on
        many keys at once, and the end of a stream that has a payload, where none is due
        (``ends_empty``).
        """

        def call(sample: zenoh.Sample) -> None:
            try:
                _check_key(str(sample.key_expr))
                attachment = sample.attachment
                header = Header.decode(attachment.to_bytes() if attachment else b"")
                if len(sample.payload) > MAX_BYTES:
                    raise MessageError(f"{len(sample.payload)} bytes, more than {MAX_BYTES}")
                if ends_empty and header.end and len(sample.payload):
                    raise MessageError("the end of a stream has no payload")
                receive(Received(str(sample.key_expr), header, sample.payload.to_bytes()))
            except MessageError as error:
                counts["malformed"] += 1
                self.log_dropped(str(sample.key_expr), error)

        handler = zenoh.handlers.Callback(call, indirect=not in_turn)
        self._declared.append(self._session.declare_subscriber(key, handler))

    def subscribe_raw(self, key: str, receive: Callable[[str, bytes], None]) -> None:
        """Call ``receive(key, payload)`` for what comes on a key, on the bus's thread."""

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

        It is called on the bus's thread, which must not wait. A query that raises ``MessageError``
        is answered by nothing.
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
        """Yield the payloads and attachments that all who answer a key reply in time."""
        try:
            replies = self._session.get(
                key,
                payload=payload,
                timeout=timeout_s,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError as error:
            log.warning("asked in vain at %s: %s", key, error)
            return
        end = time.monotonic() + timeout_s
        for reply in replies:
            if time.monotonic() > end + timeout_s:  # they would go on for ever
                return
            if reply.ok and len(reply.ok.payload) <= MAX_BYTES:
                attachment = reply.ok.attachment
                yield reply.ok.payload.to_bytes(), attachment.to_bytes() if attachment else b""

    @contextmanager
    def scoped(self) -> Iterator[None]:
        """Forget at the end of the block what is declared inside it."""
        before = len(self._declared)
        try:
            yield
        finally:
            for declared in self._declared[before:]:
                declared.undeclare()
            del self._declared[before:]

    def log_dropped(self, key: str, error: Exception) -> None:
        """Log a message that was dropped; once in a while only, for there may be many."""
        now = time.monotonic()
        if now - self._last_logged >= _LOG_EVERY_S:
            self._last_logged = now
            log.warning("dropped a message on %.200r: %s", key, error)

    def declare_alive(self, key: str) -> None:
        """Declare a liveliness token: it lives as long as this session."""
        self._declared.append(self._session.liveliness().declare_token(key))

    @contextmanager
    def sole(self, keys: Keys, service: str, identity: str) -> Iterator[None]:
        """Hold the token of a service of which a run has one, for the length of the block.

        It is declared first and others are looked for then, so that of two that start together
        none is overlooked; both give up.

        Raises:
            BusError: there is another.
        """
        own = keys.alive(service, identity)
        token = self._session.liveliness().declare_token(own)
        try:
            if self.alive(keys.all_alive(service)) - {own}:
                raise BusError(
                    f"run {keys.run!r} has a {service} already; "
                    "stop that one, or take another name with --run"
                )
            yield
        finally:
            token.undeclare()  # type: ignore[no-untyped-call]

    def alive(self, key: str) -> set[str]:
        """Return the liveliness tokens of a key that are there now."""
        found: set[str] = set()
        is_over = threading.Event()

        def call(reply: zenoh.Reply) -> None:
            if reply.ok and len(found) < MOST_TOKENS:
                found.add(str(reply.ok.key_expr))

        # Through a channel, more replies than it has room for would stop the whole session.
        handler = zenoh.handlers.Callback(call, is_over.set)
        self._session.liveliness().get(key, handler, timeout=_ALIVE_S)
        is_over.wait(_ALIVE_S)
        return set(found)

    def runs(self) -> set[str]:
        """Return the runs that have a living service."""
        return {run_of(token) for token in self.alive(EVERY_TOKEN)}

    def watch_alive(self, key: str, change: Callable[[str, bool], None]) -> None:
        """Call ``change(key, is_alive)`` for each token of a key, those there already included."""

        def call(sample: zenoh.Sample) -> None:
            change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._declared.append(
            self._session.liveliness().declare_subscriber(key, call, history=True)
        )


@contextmanager
def open_bus(
    config: BusConfig, stop: threading.Event | None = None, *, viewer: bool = False
) -> Iterator[Bus]:
    """Open a client session; it is closed at the end of the block.

    Args:
        config: where the router is, and how long to wait for it.
        stop: ends the wait.
        viewer: whether it only looks on: the router waits for no such session, and drops what one
            does not take in time. A few can be; more are as any other.

    Raises:
        BusError: the endpoint is malformed, the credentials do not fit, or no router answered
            before the wait ended.
    """
    settings = client_settings(config, _ATTEMPT_S)
    hint = "start one with 'placefield up MAP', or name another with --endpoint"
    if config.credentials:
        hint += "; if one is there, it refuses these credentials"
    attempts = _attempts(config, settings, stop, VIEWERS if viewer else ())
    with _open(attempts, f"no router at {config.endpoint}: {hint}") as bus:
        yield bus


def _attempts(
    config: BusConfig,
    settings: dict[str, Any],
    stop: threading.Event | None,
    identities: Sequence[str],
) -> Iterator[zenoh.Config]:
    """Yield what to open a session with until the wait is over, at least once.

    Each attempt is short, for no signal is heard inside it. Two thirds of them are under one of the
    identities, if there are any: another session may have it.
    """
    end = time.monotonic() + config.connect_timeout_s
    for attempt in itertools.count():
        as_one = {"id": random.choice(identities)} if identities and attempt % 3 < 2 else {}
        yield zenoh_config(config, settings | as_one)
        if time.monotonic() > end or (stop and stop.is_set()):
            return


@contextmanager
def open_router(config: BusConfig) -> Iterator[Bus]:
    """Open a session that is the router of this host, listening at the endpoint.

    It connects to the routers of other hosts that it is told, as soon as they are there.

    With credentials it lets in who has a certificate, to do what the role of it may do; without, it
    lets in whoever reaches it.

    Raises:
        BusError: the endpoint is malformed or in use, or the credentials do not fit.
    """
    settings = router_settings(config)
    if config.credentials:
        settings["access_control"] = access_control(Path(config.credentials))
    made = zenoh_config(config, settings)
    if not config.credentials and not is_local(config.endpoint):
        log.warning(
            "%s: whoever reaches this may read and publish all; see 'placefield security init -h'",
            config.endpoint,
        )
    hint = "is another router running there? Name another with --endpoint"
    with _open(iter([made]), f"cannot listen at {config.endpoint}: {hint}") as bus:
        yield bus


@contextmanager
def _open(attempts: Iterator[zenoh.Config], failure: str) -> Iterator[Bus]:
    for attempt in attempts:
        try:
            session = zenoh.open(attempt)
        except zenoh.ZError as error:
            log.debug("zenoh: %s", error)
            continue
        with session:
            yield Bus(session)
        return
    raise BusError(failure)


def _check_key(key: str) -> None:
    """Refuse what was put on all keys of a pattern: it is of no run.

    Raises:
        MessageError: it was.
    """
    if "*" in key:
        raise MessageError("it was put on many keys at once")
