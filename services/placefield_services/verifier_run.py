"""A run in a verifier: its frames, its smoothed matches, and which of them fall to it.

All verifiers of a run receive all frames and all smoothed matches. A match falls to one of those
that were alive when its frame came, by the number of the frame. The others keep frame and match
until its verified match comes: if the verifier that it falls to dies, it falls to another.

Verifiers compare frames with places at the same time, and publish in order: an answer waits for the
verified matches before it, because it depends on the posterior in the last one.
"""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage, SmoothedMessage
from placefield.bus.refusing import counting_refused
from placefield.bus.replay_cache import LENGTH, CachedPublisher, Fetch, Fetched
from placefield.bus.streams import StreamFollower, Turn
from placefield.bus.verified_messages import VerifiedMessage
from placefield.errors import MessageError
from placefield.features.frames import Frame
from placefield_services.background_query import BackgroundQuery, NotYet
from placefield_services.frame_of_message import frame_of
from placefield_services.kept_frames import FrameName, KeptFrame, KeptFrames
from placefield_services.live_verifiers import LiveVerifiers
from placefield_services.process import counting_failure
from placefield_services.verified_answers import Comparison, compare, verified_answer
from placefield_services.verified_frames import VerifiedFrames
from placefield_services.verified_versions import VerifiedVersion

MOST_WAITING = 2**15
"""The most matches of a run that wait."""

_LATE_S = 1.0  # how much later than its match a frame may come
_QUIET_S = 2.0
_OVERDUE_S = 5.0  # after that, a verifier may compare a frame that falls to another


@dataclass(frozen=True)
class VerifierLinks:
    """How a verifier publishes verified matches of a run, and fetches those that it missed."""

    verified: CachedPublisher
    fetch_smoothed: Fetch
    fetch_verified: Fetch


@dataclass(frozen=True)
class _Waiting:
    """A smoothed match that is not verified yet.

    Attributes:
        header: of the match.
        smoothed: the match.
        version: of its map.
        since: when it began to wait, monotonic seconds.
        compared: its frame with its place; None before that.
    """

    header: Header
    smoothed: SmoothedMessage
    version: VerifiedVersion
    since: float = 0.0
    compared: Comparison | None = None


class VerifierRun:
    """Verifies the smoothed matches of a run that fall to this verifier, oldest first.

    Counts the matches that it ``verified``, and those that it did not by their reason.
    """

    def __init__(
        self,
        keys: Keys,
        find_version: Callable[[str], VerifiedVersion],
        verifiers: LiveVerifiers,
        links: VerifierLinks,
        counts: Counter[str],
    ) -> None:
        """Begin.

        Args:
            keys: of the run.
            find_version: returns the version of the map that a match names, or raises
                ``OtherMapError``.
            verifiers: of the run.
            links: of the run.
            counts: of the run.
        """
        self._keys, self._find_version, self._verifiers = keys, find_version, verifiers
        self._links, self._counts = links, counts
        self._follower = StreamFollower(counts, self._join)
        self._query = BackgroundQuery(self._fetch)
        self._frames = KeptFrames()
        self._waiting: dict[FrameName, _Waiting] = {}
        self._verified = VerifiedFrames()
        self._received_at = 0.0
        """When another verifier's message came last, monotonic seconds."""
        self._reached = 0.0
        """When the newest of the matches that are verified began to wait, monotonic seconds."""
        self._newest: Header | None = None
        """The header of the newest match, or of the stream's end."""
        self._ask_at = 0.0  # monotonic seconds
        self._is_joining = False
        """Whether the stream began earlier, and its matches have not been fetched yet."""

    def accept(self, received: Received) -> None:
        """Handle a frame, a smoothed match, or a verified match of any verifier.

        Raises:
            MessageError: it is refused.
            NotYet: missed matches have been queried, and the answer has not come.
        """
        header = received.header
        if received.key == self._keys.smoothed:
            self._accept_smoothed(header, received.payload)
        elif header.end or _name(header) in self._verified:
            return
        elif received.key == self._keys.frame:
            frame = frame_of(header, FrameMessage.decode(received.payload))
            self._frames.keep(_name(header), KeptFrame(frame, self._verifiers.alive))
        else:
            self._accept_verified(header, received.payload)

    def _accept_verified(self, header: Header, payload: bytes) -> None:
        message = VerifiedMessage.decode(payload)
        self._links.verified.cache.store(header, payload)
        self._received_at = time.monotonic()
        self._finish(_name(header), message)

    def _accept_smoothed(self, header: Header, payload: bytes) -> None:
        waiting = None if header.end else self._decode(header, payload)
        turn = self._follower.follow(header)
        if turn is Turn.AFTER_GAP:
            self._catch_up(header)
        if turn in (Turn.NEXT, Turn.AFTER_GAP):
            self._newest, self._ask_at = header, time.monotonic() + _QUIET_S
            if waiting is not None:
                self._wait(waiting)
        if turn is Turn.AFTER_GAP or header.end:  # some frames have no match
            self._frames.drop_before(_name(header), self._waiting)

    def ask_if_quiet(self) -> None:
        """Fetch the next matches of an open stream after some silence: they may have been lost."""
        newest, first = self._newest, self._follower.next
        if newest is None or newest.end or time.monotonic() < self._ask_at:
            return
        try:
            smoothed, verified = self._query(newest.stream, first, first + LENGTH)
        except NotYet:
            return
        self._ask_at = time.monotonic() + _QUIET_S
        self._accept_all(verified, self._accept_verified)
        self._accept_all(smoothed, self._accept_fetched)

    def _accept_fetched(self, header: Header, payload: bytes) -> None:
        if header.sequence > self._follower.next:  # nobody has the matches before it
            gaps = header.sequence - self._follower.next
            self._follower.skip_to(header.sequence - 1, gaps=gaps)
        self._accept_smoothed(header, payload)

    def _accept_all(self, fetched: Fetched, accept: Callable[[Header, bytes], None]) -> None:
        for about, payload in fetched.values():
            with counting_refused(self._counts):
                accept(about, payload)

    def _decode(self, header: Header, payload: bytes) -> _Waiting:
        smoothed = SmoothedMessage.decode(payload)
        version = self._find_version(smoothed.map)
        if smoothed.place >= version.places:
            raise MessageError(f"place {smoothed.place} of a map of {version.places} places")
        return _Waiting(header, smoothed, version)

    def _wait(self, waiting: _Waiting) -> None:
        name = _name(waiting.header)
        if name in self._verified or name in self._waiting:
            return
        self._waiting[name] = replace(waiting, since=time.monotonic())
        if len(self._waiting) > MOST_WAITING:
            self._counts["dropped_full"] += 1
            del self._waiting[next(iter(self._waiting))]

    def _join(self, header: Header) -> int:
        """Begin a stream; return its first match that this verifier answers for.

        Matches that came before the only verifier are gaps: nobody says whether they were verified.
        """
        first = max(0, header.sequence - LENGTH)
        if self._verifiers.is_oldest:
            self._counts["gaps"] += header.sequence
            first = header.sequence
        self._is_joining = first < header.sequence
        return first

    def _catch_up(self, header: Header) -> None:
        """Let the matches before this one wait that have not come, and that nobody has verified.

        A live stream has gaps: frames that were dropped have no match.
        """
        first = self._follower.next
        if header.live and not self._is_joining:
            self._follower.skip_to(header.sequence)
            return
        smoothed, verified = self._query(header.stream, first, header.sequence)
        self._accept_all(verified, self._accept_verified)
        self._accept_all(smoothed, lambda about, missed: self._wait(self._decode(about, missed)))
        self._counts["fetched"] += len(smoothed)
        missing = 0 if self._is_joining else header.sequence - first - len(smoothed)
        self._follower.skip_to(header.sequence, gaps=missing)
        self._is_joining = False

    def _fetch(self, stream: str, first: int, end: int) -> tuple[Fetched, Fetched]:
        """Fetch the matches of some frames, smoothed and verified; this runs in its own thread."""
        smoothed = self._links.fetch_smoothed(stream, first, end)
        return smoothed, self._links.fetch_verified(stream, first, end)

    def _finish(self, name: FrameName, message: VerifiedMessage) -> None:
        waiting = self._waiting.pop(name, None)
        if waiting is not None:
            self._reached = max(self._reached, waiting.since)
        self._frames.drop(name)
        self._verified.add(name, message.posterior)

    def verify_next(self) -> bool:
        """Publish what is due, and compare the next frame that falls to this verifier.

        Returns:
            Whether there was such a frame.
        """
        self._publish_in_order()
        name = self._next(time.monotonic())
        if name is None:
            return False
        waiting, kept = self._waiting[name], self._frames.find(name)
        waiting.version.check_unchanged()  # its files are memory-mapped
        compared = self._compare(waiting, None if kept is None else kept.frame)
        self._waiting[name] = replace(waiting, compared=compared)
        return True

    def _publish_in_order(self) -> None:
        """Publish the answers that wait for no earlier match.

        If a later match is verified already, the message of an earlier one was lost, or will be
        late: nothing waits for that.
        """
        for name, waiting in list(self._waiting.items()):
            if waiting.compared is not None:
                self._publish(name, waiting, waiting.compared)
            elif waiting.since >= self._reached:
                return

    def _publish(self, name: FrameName, waiting: _Waiting, compared: Comparison) -> None:
        before, stage = self._verified.before(name), waiting.version.stage
        answer = verified_answer(waiting.smoothed, compared, stage, before)
        self._counts[answer.reason or "verified"] += 1
        self._finish(name, answer)
        self._links.verified.put(waiting.header, answer)

    def _next(self, now: float) -> FrameName | None:
        """Return the oldest match that falls to this verifier; if none does, one that is overdue.

        Of the overdue ones it is the newest, as the verifier that they fall to begins with the
        oldest. But if nothing comes from another, all that is overdue falls to this one. Matches
        without a frame fall to the oldest verifier: no other has more frames.
        """
        is_silent = now - self._received_at >= _OVERDUE_S
        overdue = None
        for name, waiting in self._waiting.items():
            if waiting.compared is not None:
                continue
            frame, age = self._frames.find(name), now - waiting.since
            is_overdue = age >= _OVERDUE_S
            if frame is None:
                is_own = self._verifiers.is_oldest and age >= _LATE_S
            else:
                is_own = self._verifiers.is_own(name[1], frame.verifiers)
            if is_own or (is_overdue and is_silent):
                return name
            if frame is not None and is_overdue:
                overdue = name
        return overdue

    def _compare(self, waiting: _Waiting, frame: Frame | None) -> Comparison:
        with counting_failure([self._counts]):
            return compare(waiting.smoothed.match, frame, waiting.version.stage)
        return Comparison("failed")


def _name(header: Header) -> FrameName:
    return header.stream, header.sequence
