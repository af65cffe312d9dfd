"""Follows a stream of raw features from its first frame on, and fetches what was missed."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.bus.refusing import counting_refused
from placefield.bus.replay_cache import LENGTH, Fetch, Fetched, fetched_frame
from placefield.bus.streams import StreamFollower, Turn
from placefield.errors import OtherMapError
from placefield_services.background_query import NotYet

_PAGE = 100  # frames that are fetched and handed on before the service looks around again
_ASK_FOR_S, _ASK_EVERY_S = 3.0, 0.3


@dataclass(frozen=True)
class StreamFrame:
    """A frame of a stream, or the end of it.

    Attributes:
        header: of the frame.
        feature: of the frame; None at the end.
        is_awaited: whether its source may still wait for an answer.
    """

    header: Header
    feature: FeatureMessage | None
    is_awaited: bool


class WholeStream:
    """Hands on each frame of a stream once, in order, and at last its end.

    A service that joins a stream late, or missed a part of it, fetches the frames before it goes
    on. Frames that nobody has are left out.
    """

    def __init__(
        self,
        digest: str,
        fetch: Fetch,
        begin: Callable[[Header], int],
        hand_on: Callable[[StreamFrame], None],
        counts: Counter[str],
    ) -> None:
        """Follow one stream after the other.

        Args:
            digest: of the exploration; features of another kind are refused.
            fetch: fetches the features of some frames from other services, or raises ``NotYet``.
            begin: called with the first header of a stream that comes; returns the first frame to
                hand on.
            hand_on: called with each frame.
            counts: counts ``fetched`` frames, and see ``StreamFollower``.
        """
        self._digest = digest
        self._fetch = fetch
        self._begin = begin
        self._hand_on = hand_on
        self._counts = counts
        self._follower = StreamFollower(counts, self._join)
        self.is_forgotten = False
        """Whether frames of the stream are missing that nobody has; see ``Match``."""
        self._ask_until = 0.0  # monotonic seconds

    def accept(self, header: Header, payload: bytes) -> Turn:
        """Hand on the frame of a message, after those before it; return where it was in order.

        A frame that comes again is not handed on again.

        Raises:
            MessageError: the message is refused.
            NotYet: not all frames before it have been handed on; call again.
        """
        feature = None if header.end else self._decode(payload)
        turn = self._follower.follow(header)
        if turn is Turn.AFTER_GAP:
            self._catch_up(header)
            self._follower.skip_to(header.sequence, gaps=0)
        if turn in (Turn.NEXT, Turn.AFTER_GAP):
            self._hand_on(StreamFrame(header, feature, is_awaited=True))
        return turn

    def _join(self, header: Header) -> int:
        self.is_forgotten = False
        self._ask_until = time.monotonic() + _ASK_FOR_S
        return self._begin(header)

    def _decode(self, payload: bytes) -> FeatureMessage:
        feature = FeatureMessage.decode(payload)
        if feature.model != self._digest:
            raise OtherMapError(
                f"descriptor of model {feature.model!r}, but this service explores with "
                f"{self._digest}; give all services one features.kind"
            )
        return feature

    def _catch_up(self, header: Header) -> None:
        """Hand on the frames before this one, a page at a time.

        Raises:
            NotYet: some of them have not been handed on; call again.
        """
        first = self._follower.next
        end = min(first + _PAGE, header.sequence)
        fetched = self._fetch(header.stream, first, end)
        missing = end - first - len(fetched)
        if missing and not header.live and time.monotonic() < self._ask_until:
            raise NotYet(_ASK_EVERY_S)
        # A live stream drops frames on purpose, so missing frames alone do not mean a loss.
        if missing and (not header.live or (first == 0 and not fetched)):
            self.is_forgotten = True
        if not fetched:  # those after them are missing, too, but for what short caches have
            end = max(end, header.sequence - LENGTH)
        self._hand_on_fetched(header, fetched)
        self._follower.skip_to(end - 1, gaps=end - first - len(fetched))
        if end < header.sequence:
            raise NotYet(0.0)
        self._ask_until = time.monotonic() + _ASK_FOR_S

    def _hand_on_fetched(self, header: Header, fetched: Fetched) -> None:
        for old, payload in fetched.values():
            with counting_refused(self._counts):
                feature = self._decode(payload)
                old, is_awaited = fetched_frame(old, header)
                self._hand_on(StreamFrame(old, feature, is_awaited))
        self._counts["fetched"] += len(fetched)
