"""A run in the fuser: its streams, one after the other, under one version of the map or two."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from placefield.bus.candidate_messages import CandidatesMessage, FinishedMessage
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.bus.refusing import counting_refused
from placefield.bus.replay_cache import ReplicatedCache
from placefield.bus.streams import Arrival, StreamSwitch
from placefield_services.background_query import BackgroundQuery
from placefield_services.candidate_decoder import decode_candidates
from placefield_services.fuser_stream import FuserStream
from placefield_services.fusion_parts import FusionParts, RunParts
from placefield_services.held_candidates import HeldCandidates
from placefield_services.live_channels import LiveChannels
from placefield_services.next_version import NextVersion
from placefield_services.served import FuserVersion

_Message = FeatureMessage | CandidatesMessage | FinishedMessage


@dataclass(frozen=True)
class FuserCaches:
    """What a fuser remembers for others, and what others do for it.

    Attributes:
        features: descriptors of the stream.
        moments: of the stream.
        fetch_candidates: yields what channel workers have published of a stream, of frames from
            one up to another.
    """

    features: ReplicatedCache
    moments: ReplicatedCache
    fetch_candidates: Callable[[str, int, int], Iterable[tuple[Header, bytes]]]


class FuserRun:
    """Follows the streams of a run, one after the other, and hands on what comes of each."""

    def __init__(self, first: FuserVersion, keys: Keys, run: RunParts, caches: FuserCaches) -> None:
        """Begin without a stream.

        Args:
            first: the version of the map that answers at first.
            keys: of the run.
            run: what it shares under every version.
            caches: of the run.
        """
        self._feature_key = keys.feature
        self._run, self._parts = run, run.under(first)
        self._caches = caches
        counts = self._counts = run.counts
        self._next: NextVersion | None = None
        self._left = ""
        """Digest of the version before the current one; workers may still answer by it."""
        self._switch = StreamSwitch(counts)
        self._held = HeldCandidates(counts)
        self._query = BackgroundQuery(self._fetch)
        self._stream = FuserStream(self._parts, 0, live=False)

    @property
    def channels(self) -> LiveChannels:
        """Which channels there are, and which are alive."""
        return self._run.channels

    @property
    def digest(self) -> str:
        """Digest of the version of the map that answers."""
        return self._parts.served.digest

    def offer(self, version: FuserVersion, is_there: Callable[[], bool]) -> None:
        """Make a version of the map the next one; it displaces one that still is.

        Args:
            version: the version.
            is_there: see ``NextVersion``.
        """
        self._next = None
        if version.served.digest != self.digest:
            self._next = NextVersion(self._run.under(version), self._stream, is_there)

    def handle(self, received: Received) -> None:
        """Handle a descriptor, which announces a frame, or candidates.

        Only a descriptor begins a stream; candidates that come before it wait for it.

        Raises:
            MessageError: it is refused.
            NotYet: it is of a stream that is on already, and the answer of other services, which
                know more of that, has not come.
        """
        header = received.header
        is_feature = received.key == self._feature_key
        message = None if header.end and is_feature else self._decode(received)
        if not isinstance(message, FeatureMessage | None) and message.map == self._left:
            self._counts["stale"] += 1
            return
        if is_feature and not self._follow(received):
            return
        if self._switch.has_left(header.stream):
            self._counts["stale"] += 1
        elif header.stream != self._switch.stream:
            self._held.hold(received)
        else:
            self._hand_on(header, message)

    def _decode(self, received: Received) -> _Message:
        if received.key == self._feature_key:
            return FeatureMessage.decode(received.payload)
        message = decode_candidates(received.header, received.payload)
        if message.map != self._left:
            self._version_of(message)[0].decoder.check_message(message)
        return message

    def _version_of(
        self, message: CandidatesMessage | FinishedMessage
    ) -> tuple[FusionParts, FuserStream]:
        """Return what answers by the map of a message: the next version, else the current one."""
        if self._next is not None and message.map == self._next.digest:
            return self._next.parts, self._next.stream
        return self._parts, self._stream

    def _hand_on(self, header: Header, message: _Message | None) -> None:
        """Hand a message to the stream that is on; None is the featurizer's end of it."""
        stream = self._stream
        if isinstance(message, CandidatesMessage | FinishedMessage):
            _, stream = self._version_of(message)
        if isinstance(message, FeatureMessage | CandidatesMessage) and message.forgotten:
            stream.is_forgotten = True  # and all frames after it, too
        if not header.live:
            self._skip_to(header)
            if self._stream.is_out_of_order(header):
                self._counts["out_of_order"] += 1
                return
        now = time.monotonic()
        if message is None:
            stream.end(header)
        elif isinstance(message, FeatureMessage):
            stream.announce(header, now)
        else:
            stream.add(header, message, now)

    def _skip_to(self, header: Header) -> None:
        """Count frames that the source awaits no more as answered, by a fuser before this one."""
        if self._stream.skip_to(header.oldest):
            self._smooth_answered(header.stream, header.oldest)

    def _smooth_answered(self, stream: str, end: int) -> None:
        """Smooth the newest frames before this one: the fuser that answered them may not have.

        Those that it has smoothed are published a second time.
        """
        smoothing = self._stream.smoothing
        first = max(0, end - smoothing.lag)
        for header in self._caches.features.cache.headers(stream, first, end):
            if not header.end:
                smoothing.announce(header)

    def _follow(self, received: Received) -> bool:
        """Enter the stream of a descriptor; False if it was left."""
        header = received.header
        is_on = self._switch.begins(header) and header.sequence > 0
        fetched = self._query(header.stream, header) if is_on else []
        arrival = self._switch.enter(header)
        if arrival is Arrival.DROPPED:
            return False
        if arrival is Arrival.NEW_STREAM:
            self._begin(header)
            if is_on:
                self._go_on(header, fetched)
            self._handle_held()
        features = self._caches.features.cache
        came_again = features.find(header) is not None
        features.store(header, received.payload)
        if came_again and self._stream.is_released(header.sequence) and not header.live:
            self._parts.publisher.answer_again(header)
        return True

    def _begin(self, header: Header) -> None:
        """Begin a stream, and publish what the one before it still owes."""
        self._parts.served.check_unchanged()
        self._stream.abandon()
        if self._next is not None and self._next.can_begin():
            self._set_version(self._next.parts)
        self._stream = FuserStream(self._parts, header.oldest, live=header.live)
        if self._next is not None:
            self._next.begin(header.oldest, live=header.live)

    def _handle_held(self) -> None:
        for candidates in self._held.pop_all():
            with counting_refused(self._counts):  # it must not cost the descriptor
                self.handle(candidates)

    def _fetch(self, stream: str, header: Header) -> list[tuple[Header, bytes]]:
        """Fetch what other services know of a stream that is on, before they forget it.

        Returns the candidates that may have to be smoothed. It runs in a thread of its own.
        """
        self._caches.features.fill(header)
        self._caches.moments.fill(header)
        first = max(0, _answered(header) - self._stream.smoothing.lag)
        fetch = self._caches.fetch_candidates
        return list(fetch(stream, first, header.sequence + 2 * WINDOW))

    def _go_on(self, header: Header, candidates: Iterable[tuple[Header, bytes]]) -> None:
        """Go on with a stream that was on."""
        self._smooth_answered(header.stream, _answered(header))
        now = time.monotonic()
        for old, payload in candidates:
            with counting_refused(self._counts):
                message = self._parts.decoder.decode(old, payload)
                self._stream.smoothing.add(old.sequence, message, now)

    def release(self) -> None:
        """Publish the matches that are due, smoothed ones, and the last one's credit."""
        now = time.monotonic()
        if self._next is not None and self._next.can_continue(self._stream):
            self._go_over(self._next, now)
        self._parts.served.check_unchanged()  # poses of a map that was written to are nobody's
        self._stream.release(now)

    def _go_over(self, following: NextVersion, now: float) -> None:
        """Answer by the next version from the oldest unanswered frame on."""
        following.stream.continue_from(self._stream, now)
        self._stream = following.stream
        self._set_version(following.parts)

    def _set_version(self, parts: FusionParts) -> None:
        self._left = self.digest
        self._parts, self._next = parts, None


def _answered(header: Header) -> int:
    """Return up to which frame a stream was answered, by the first of it that came."""
    return header.sequence if header.live else header.oldest
