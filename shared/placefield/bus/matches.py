"""Reads the matches of a run from the bus, in order."""

import math
import queue
import time
from collections import Counter, deque
from collections.abc import Container, Iterable, Iterator
from contextlib import suppress

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.bus.replay_cache import LENGTH, Fetch, fetcher
from placefield.bus.session import Bus
from placefield.bus.streams import StreamFollower, Turn
from placefield.bus.verified_messages import VerifiedMessage
from placefield.errors import MessageError, OtherMapError

_QUIET_S = 2.0

OrderedMatch = tuple[Header, MatchMessage | None]
"""A header and its match; at the end of a stream, no match."""


class MatchQueue:
    """A queue of a run's matches from now on, each once; on request of all its kinds of matches.

    Matches come in order, and so do smoothed matches. The end of a stream comes after both. Lost
    matches of a lossless stream are fetched from the fuser's replay cache. Verified matches come in
    any order, and also after the end.
    """

    def __init__(
        self,
        bus: Bus,
        keys: Keys,
        *,
        smoothed: bool = False,
        verified: bool = False,
        digests: Container[str] | None = None,
    ) -> None:
        """Subscribe to the matches of a run.

        Args:
            bus: the session.
            keys: of the run.
            smoothed: whether to return smoothed matches, too, as ``SmoothedMessage``.
            verified: whether to return verified matches, too, as ``VerifiedMessage``.
            digests: of the maps that matches may be of; None: any map.
        """
        self.counts: Counter[str] = Counter()
        self._received: queue.SimpleQueue[Received] = queue.SimpleQueue()
        self._ready: deque[OrderedMatch] = deque()
        kinds = {keys.match: MatchMessage} | ({keys.smoothed: SmoothedMessage} if smoothed else {})
        self._readers: dict[str, _InOrder | _InAnyOrder] = {
            key: _InOrder(kind, fetcher(bus, keys.cache(key)), self.counts, digests)
            for key, kind in kinds.items()
        }
        self._ended = dict.fromkeys(kinds, "")  # stream, by key
        if verified:
            fetch = fetcher(bus, keys.cache(keys.verified))
            self._readers[keys.verified] = _InAnyOrder(fetch, digests)
        for key in self._readers:
            bus.subscribe(key, self._received.put, self.counts)

    def get(self, timeout: float) -> OrderedMatch | None:
        """Return the next header and match; at the end of a stream, a header and no match.

        Returns None if nothing comes within ``timeout`` seconds.

        Raises:
            MessageError: a message does not parse, or is of another map.
        """
        end = time.monotonic() + timeout
        while not self._ready:
            try:
                received = self._received.get(timeout=max(0.0, end - time.monotonic()))
            except queue.Empty:
                for key, reader in self._readers.items():
                    self._keep(key, reader.ask_if_quiet())
                return self._ready.popleft() if self._ready else None
            reader = self._readers[received.key]
            self._keep(received.key, reader.receive(received.header, received.payload))
        return self._ready.popleft()

    def _keep(self, key: str, ready: Iterable[OrderedMatch]) -> None:
        for header, match in ready:
            if match is None:
                self._ended[key] = header.stream
            if match is not None or set(self._ended.values()) == {header.stream}:
                self._ready.append((header, match))


class _InOrder:
    """Puts the messages of one key in order, and fetches missing messages."""

    def __init__(
        self,
        kind: type[MatchMessage],
        fetch: Fetch,
        counts: Counter[str],
        digests: Container[str] | None,
    ) -> None:
        self._kind = kind
        self._digests = digests
        self._fetch = fetch
        self._follower = StreamFollower(counts, lambda header: header.sequence)
        self._open_stream: str | None = None
        self._ask_at = 0.0

    def ask_if_quiet(self) -> list[OrderedMatch]:
        """Fetch the next messages after some silence: they may have been lost."""
        if self._open_stream is None or time.monotonic() < self._ask_at:
            return []
        self._ask_at = time.monotonic() + _QUIET_S
        first = self._follower.next
        fetched = self._fetch(self._open_stream, first, first + LENGTH).values()
        return [
            ready
            for header, payload in fetched
            if header.end or self._decoded(payload)
            for ready in self.receive(header, payload)
        ]

    def receive(self, header: Header, payload: bytes) -> list[OrderedMatch]:
        """Return the matches whose turn has come with this message."""
        self._ask_at = time.monotonic() + _QUIET_S
        match = None if header.end else self._decode(payload)
        turn = self._follower.follow(header)
        ready: list[OrderedMatch] = []
        if turn is Turn.AFTER_GAP:
            ready = [] if header.live else self._missed(header)
            gap = header.sequence - self._follower.next
            self._follower.skip_to(header.sequence, gap - len(ready))
        if turn in (Turn.NEXT, Turn.AFTER_GAP):
            ready.append((header, match))
            self._open_stream = None if header.end or header.live else header.stream
        return ready

    def _missed(self, header: Header) -> list[OrderedMatch]:
        fetched = self._fetch(header.stream, self._follower.next, header.sequence)
        decoded = ((old, self._decoded(payload)) for old, payload in fetched.values())
        return [(old, match) for old, match in decoded if match is not None]

    def _decode(self, payload: bytes) -> MatchMessage:
        match = self._kind.decode(payload)
        _check_map(match, self._digests)
        return match

    def _decoded(self, payload: bytes) -> MatchMessage | None:
        """Return a fetched match; None if it must be refused."""
        try:
            return self._decode(payload)
        except MessageError:
            return None


class _InAnyOrder:
    """Returns verified matches as they come, each once, and fetches missing ones after silence."""

    def __init__(self, fetch: Fetch, digests: Container[str] | None) -> None:
        self._fetch, self._digests = fetch, digests
        self._seen: dict[tuple[str, int], None] = {}
        self._newest: Header | None = None
        self._ask_at = math.inf

    def ask_if_quiet(self) -> list[OrderedMatch]:
        """Fetch the last matches once after some silence: some may have been lost."""
        newest = self._newest
        if newest is None or time.monotonic() < self._ask_at:
            return []
        self._ask_at = math.inf
        first = max(0, newest.sequence - LENGTH)
        ready: list[OrderedMatch] = []
        for header, payload in self._fetch(newest.stream, first, newest.sequence + LENGTH).values():
            with suppress(MessageError):
                ready += self._unseen(header, payload)
        return ready

    def receive(self, header: Header, payload: bytes) -> list[OrderedMatch]:
        """Return the match of a message, unless it was returned before."""
        self._ask_at = time.monotonic() + _QUIET_S
        return self._unseen(header, payload)

    def _unseen(self, header: Header, payload: bytes) -> list[OrderedMatch]:
        name = header.stream, header.sequence
        if header.end or name in self._seen:
            return []
        match = VerifiedMessage.decode(payload)
        _check_map(match, self._digests)
        self._newest = header
        self._seen[name] = None
        if len(self._seen) > 4 * LENGTH:
            del self._seen[next(iter(self._seen))]
        return [(header, match)]


def _check_map(match: MatchMessage, digests: Container[str] | None) -> None:
    if digests is not None and match.map not in digests:
        raise OtherMapError(f"{type(match).__name__} of map {match.map}, which is another map")


def stream_matches(matches: MatchQueue, timeout: float) -> Iterator[tuple[Header, MatchMessage]]:
    """Yield matches until the stream ends, or until none has come for ``timeout`` seconds."""
    while (ready := matches.get(timeout)) is not None:
        header, match = ready
        if match is None:
            return
        yield header, match
