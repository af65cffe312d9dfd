"""The newest messages of a stream, kept for whoever has missed them.

A service that is started again in the midst of a stream asks for what came before. One that is sent
a frame again finds what it has made of it, and sends that again.
"""

import itertools
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from placefield.bus.message import Header, Message
from placefield.bus.messages import CacheQuery
from placefield.bus.session import Bus, Publisher
from placefield.errors import MessageError

LENGTH = 1000
"""Frames: what was before so many changes nothing that matters."""

MOMENTS = 64
"""Frames whose moments are kept: who comes back asks for those of the last one."""

_PATIENCE_S = 1.0
_MOST_REPLIES = 64 * LENGTH
_MOST_BYTES = 2**30

Fetched = Mapping[int, tuple[Header, bytes]]
"""Headers and payloads, by ascending sequence."""

Fetch = Callable[[str, int, int], Fetched]
"""Returns what others remember of frames from one up to another of a stream; see ``fetcher``."""


class ReplayCache:
    """The newest messages of one stream on one key; of a new stream, once there is one.

    One thread may remember while another replies.
    """

    def __init__(self, length: int = LENGTH) -> None:
        self._length = length
        self._stream = ""
        self._kept: dict[int, tuple[Header, bytes]] = {}
        self._lock = threading.Lock()

    def store(self, header: Header, payload: bytes) -> None:
        """Keep a message; the first that came makes room for it."""
        with self._lock:
            if header.stream != self._stream:
                self._stream = header.stream
                self._kept.clear()
            self._kept[header.sequence] = header, payload
            if len(self._kept) > self._length:
                del self._kept[next(iter(self._kept))]

    @property
    def newest(self) -> Header | None:
        """The header of the message that came last; none if none has."""
        with self._lock:
            return next(reversed(self._kept.values()))[0] if self._kept else None

    def find(self, header: Header) -> bytes | None:
        """Return the payload that was kept of this frame of this stream, if one was."""
        with self._lock:
            if header.stream != self._stream or header.sequence not in self._kept:
                return None
            return self._kept[header.sequence][1]

    def headers(self, stream: str, first: int, end: int) -> list[Header]:
        """Return the headers that are kept of frames ``first`` to ``end`` - 1, in order."""
        with self._lock:
            kept = list(self._kept.values()) if stream == self._stream else []
        headers = (header for header, _ in kept if first <= header.sequence < end)
        return sorted(headers, key=lambda header: header.sequence)

    def reply(self, asked: bytes) -> Iterator[tuple[bytes, bytes]]:
        """Yield payloads and attachments of what a query asks for.

        Raises:
            MessageError: it is no ``CacheQuery``.
        """
        query = CacheQuery.decode(asked)
        with self._lock:
            kept = list(self._kept.values()) if query.stream == self._stream else []
        for header, payload in kept:
            if query.first <= header.sequence < query.end:
                yield payload, header.encode()


class CachedPublisher:
    """Publishes what a service makes of each frame, and remembers it."""

    def __init__(self, publisher: Publisher, cache: ReplayCache) -> None:
        """Take where to publish and what to remember it in."""
        self._publisher = publisher
        self.cache = cache

    def put(self, header: Header, message: Message | None = None) -> None:
        """Send a message with its header; no message at the end of a stream."""
        payload = message.encode() if message else b""
        self.cache.store(header, payload)
        self._publisher.send(header, payload)

    def put_again(self, header: Header) -> bool:
        """Send what was sent of this frame; False if it is not remembered."""
        payload = self.cache.find(header)
        if payload is not None:
            self._publisher.send(header, payload)
        return payload is not None


def serve_cache(bus: Bus, key: str, cache: ReplayCache) -> None:
    """Answer those who ask for this cache at a key."""
    bus.answer(key, lambda _, asked: cache.reply(asked))


@dataclass(frozen=True)
class ReplicatedCache:
    """What a service remembers of a key, and what asks the others who do."""

    cache: ReplayCache
    fetch: Fetch

    def fill(self, header: Header) -> None:
        """Remember what others do of the frames before this one."""
        first = max(0, header.sequence - LENGTH)
        for old, payload in self.fetch(header.stream, first, header.sequence).values():
            self.cache.store(old, payload)


def replicated_cache(bus: Bus, key: str, length: int = LENGTH) -> ReplicatedCache:
    """Return a memory that is shared at a key."""
    cache = ReplayCache(length)
    serve_cache(bus, key, cache)
    return ReplicatedCache(cache, fetcher(bus, key))


def fetcher(bus: Bus, key: str) -> Fetch:
    """Return what asks all who share a cache of one key."""

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
    """Yield what each who shares a cache remembers of frames ``first`` to ``end`` - 1."""
    query = CacheQuery(stream=stream, first=first, end=end)
    replies = bus.ask(key, query.encode(), timeout_s=_PATIENCE_S)
    held = 0
    for payload, attachment in itertools.islice(replies, _MOST_REPLIES):
        held += len(payload)
        if held > _MOST_BYTES:
            return
        try:
            header = Header.decode(attachment)
        except MessageError:
            continue
        if header.stream == stream and first <= header.sequence < end:
            yield header, payload
