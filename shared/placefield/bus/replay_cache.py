"""Replay caches: the newest messages of a stream, kept for services that missed them.

A service that restarts during a stream fetches the earlier messages from the caches of others. A
service that gets a frame again looks up its own result and publishes that again.
"""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice

from placefield.bus.message import Header, Message
from placefield.bus.messages import CacheQuery
from placefield.bus.publishing import Publisher
from placefield.bus.session import Bus
from placefield.errors import MessageError

LENGTH = 1000
"""The number of frames kept; older frames have no effect that matters."""

MOMENTS = 64
"""The number of frames whose moments are kept; a restarted service needs only the newest."""

_PATIENCE_S = 1.0
_MOST_REPLIES = 64 * LENGTH
_MOST_BYTES = 2**30

Fetched = Mapping[int, tuple[Header, bytes]]
"""Headers and payloads, by ascending sequence."""

Fetch = Callable[[str, int, int], Fetched]
"""Fetches the messages of a stream's frames ``first`` to ``end`` - 1; see ``fetcher``."""


class ReplayCache:
    """The newest messages of one stream on one key. A new stream replaces the old one.

    One thread may store while another replies.
    """

    def __init__(self, length: int = LENGTH) -> None:
        self._length = length
        self._stream = ""
        self._kept: dict[int, tuple[Header, bytes]] = {}
        self._lock = threading.Lock()

    def store(self, header: Header, payload: bytes) -> None:
        """Keep a message; when the cache is full, drop the one that came first."""
        with self._lock:
            if header.stream != self._stream:
                self._stream = header.stream
                self._kept.clear()
            self._kept[header.sequence] = header, payload
            if len(self._kept) > self._length:
                del self._kept[next(iter(self._kept))]

    @property
    def newest(self) -> Header | None:
        """The header of the message that came last; None if the cache is empty."""
        with self._lock:
            return next(reversed(self._kept.values()))[0] if self._kept else None

    def find(self, header: Header) -> bytes | None:
        """Return the payload of this frame; None if it is not in the cache."""
        with self._lock:
            if header.stream != self._stream or header.sequence not in self._kept:
                return None
            return self._kept[header.sequence][1]

    def headers(self, stream: str, first: int, end: int) -> list[Header]:
        """Return the cached headers of frames ``first`` to ``end`` - 1 of a stream, in order."""
        with self._lock:
            kept = list(self._kept.values()) if stream == self._stream else []
        headers = (header for header, _ in kept if first <= header.sequence < end)
        return sorted(headers, key=lambda header: header.sequence)

    def messages(self, stream: str, end: int) -> list[tuple[Header, bytes]]:
        """Return the cached messages of a stream's frames before ``end``, in order."""
        with self._lock:
            kept = list(self._kept.values()) if stream == self._stream else []
        before = [(header, payload) for header, payload in kept if header.sequence < end]
        return sorted(before, key=lambda message: message[0].sequence)

    def another(self) -> "ReplayCache":
        """Return an empty cache of the same length."""
        return ReplayCache(self._length)

    def reply(self, asked: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Yield the payloads and attachments that a query asks for.

        Raises:
            MessageError: ``asked`` is no ``CacheQuery``.
        """
        query = CacheQuery.decode(asked)
        with self._lock:
            kept = list(self._kept.values()) if query.stream == self._stream else []
        for header, payload in kept:
            if query.first <= header.sequence < query.end:
                yield payload, header.encode()


class CachedPublisher:
    """Publishes a service's result for each frame, and keeps it in a replay cache."""

    def __init__(self, publisher: Publisher, cache: ReplayCache) -> None:
        """Publish with ``publisher``, and keep each message in ``cache``."""
        self._publisher = publisher
        self.cache = cache
        self.caches = [cache]
        """The caches of all publishers that ``another`` has made of one."""

    def another(self) -> "CachedPublisher":
        """Return a publisher on the same key that has a cache of its own."""
        other = CachedPublisher(self._publisher, self.cache.another())
        self.caches.append(other.cache)
        other.caches = self.caches
        return other

    def retire(self) -> None:
        """Remove this publisher's cache from ``caches``."""
        self.caches.remove(self.cache)

    def put(self, header: Header, message: Message | None = None) -> None:
        """Send a message with its header; no message at the end of a stream."""
        payload = message.encode() if message else b""
        self.cache.store(header, payload)
        self._publisher.send(header, payload)

    def put_again(self, header: Header) -> bool:
        """Send the cached message of this frame again; False if it is not in the cache."""
        payload = self.cache.find(header)
        if payload is not None:
            self._publisher.send(header, payload)
        return payload is not None


def serve_cache(bus: Bus, key: str, cache: ReplayCache) -> None:
    """Answer queries at a key from this cache."""
    serve_caches(bus, key, [cache])


def serve_caches(bus: Bus, key: str, caches: Sequence[ReplayCache]) -> None:
    """Answer queries at a key from these caches; caches may be added and removed later."""
    bus.answer(key, lambda _, asked: chain.from_iterable(one.reply(asked) for one in list(caches)))


@dataclass(frozen=True)
class ReplicatedCache:
    """A service's own replay cache of a key, and access to the caches of the other services."""

    cache: ReplayCache
    fetch: Fetch

    def fill(self, header: Header) -> None:
        """Store the messages of earlier frames that other services have cached."""
        first = max(0, header.sequence - LENGTH)
        for old, payload in self.fetch(header.stream, first, header.sequence).values():
            self.cache.store(old, payload)


def replicated_cache(bus: Bus, key: str, length: int = LENGTH) -> ReplicatedCache:
    """Return a replay cache that answers queries at a key, and can query the other caches there."""
    cache = ReplayCache(length)
    serve_cache(bus, key, cache)
    return ReplicatedCache(cache, fetcher(bus, key))


def fetcher(bus: Bus, key: str) -> Fetch:
    """Return a function that fetches messages from all replay caches at a key."""

    def fetch(stream: str, first: int, end: int) -> Fetched:
        fetched = {
            header.sequence: (header, payload)
            for header, payload in fetch_all(bus, key, stream, first, end)
        }
        return dict(sorted(fetched.items()))

    return fetch


def fetch_all(
    bus: Bus,
    key: str,
    stream: str,
    first: int,
    end: int,
) -> Iterator[tuple[Header, bytes]]:
    """Yield the messages of frames ``first`` to ``end`` - 1 that each replay cache at a key has."""
    query = CacheQuery(stream=stream, first=first, end=end)
    replies = bus.ask(key, query.encode(), timeout_s=_PATIENCE_S)
    held = 0
    for payload, attachment in islice(replies, _MOST_REPLIES):
        held += len(payload)
        if held > _MOST_BYTES:
            return
        try:
            header = Header.decode(attachment)
        except MessageError:
            continue
        if header.stream == stream and first <= header.sequence < end:
            yield header, payload


def fetched_frame(old: Header, newest: Header) -> tuple[Header, bool]:
    """Return the header of a fetched frame, and whether its source may still wait for an answer.

    Args:
        old: the header of the frame, as it was cached.
        newest: the header of a later frame, which has just come.
    """
    is_awaited = not newest.live and old.sequence >= newest.oldest
    return old.model_copy(update={"oldest": min(newest.oldest, old.sequence)}), is_awaited
