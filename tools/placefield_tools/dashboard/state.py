"""The newest answers of a run, each with the frame, candidates and distances it was made of.

This module has no bus and draws nothing: callers pass the messages.
"""

from collections import Counter, OrderedDict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from placefield.bus.candidate_messages import CandidatesMessage, ChannelCandidate
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage, MatchMessage, SmoothedMessage
from placefield.config import Rule
from placefield.errors import FrameError, MessageError
from placefield.fusion.shard_joiner import ShardJoiner
from placefield.maps.map import Map, fingerprint
from placefield.matching.candidate import Candidate
from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.distance_columns import DistanceColumns, Row
from placefield_tools.dashboard.fields import thinned
from placefield_tools.dashboard.stream_summary import StreamSummary

KEPT = 600
"""Number of answers that a viewer can look back over."""

_KEPT_BYTES = 64 * 2**20  # encoded frames of the kept answers
_UNDER_WAY = 256  # frames that are not answered yet


@dataclass
class _UnderWay:
    """The messages of a frame so far."""

    rule: Rule | None = None
    shards: ShardJoiner | None = None
    candidates: dict[int, Candidate] = field(default_factory=dict)
    distances: Row | None = None


_Key = tuple[str, int]  # stream and sequence


class ShownMap(NamedTuple):
    """A version of the map, and its columns of distances."""

    placemap: Map
    columns: DistanceColumns

    @classmethod
    def of(cls, placemap: Map) -> "ShownMap":
        """Make the columns of a map, which takes a moment."""
        return cls(placemap, DistanceColumns(placemap))


class LiveState:
    """The newest answers of a run, at most ``KEPT``, all of one version of the map.

    Counts ``missed`` answers between two answers of a lossless stream, and ``foreign`` messages,
    which belong to another map. Foreign messages are not shown.
    """

    def __init__(self, placemap: Map, tolerance: int) -> None:
        """Begin without answers; places up to ``tolerance`` apart count as the same."""
        self._tolerance = tolerance
        self._shown = ShownMap.of(placemap)
        self._next: ShownMap | None = None
        self._answered = 0
        self.answers: deque[Answer] = deque(maxlen=KEPT)
        self.counts: Counter[str] = Counter()
        self.ended: Header | None = None
        """The end of the last answered stream, if that stream has ended."""
        self._stopped: str | None = None  # the stream that was stopped by hand
        self.summary: StreamSummary | None = None
        """What the last answered stream came to so far."""
        self.foreign_map: str | None = None
        """Digest of the map of the last match, if that is another map than the shown one."""
        self.newest_smoothed: Header | None = None
        """The header of the smoothed match that came last."""
        self._smoothed: OrderedDict[_Key, SmoothedMessage] = OrderedDict()
        self._numbers: dict[_Key, int] = {}  # of the kept answers
        # All versions of a map have one model.
        self._model = fingerprint(placemap.model)
        self._descriptors = placemap.model
        self._under_way: OrderedDict[_Key, _UnderWay] = OrderedDict()
        self._frames: OrderedDict[_Key, bytes] = OrderedDict()
        self._frame_bytes = 0

    @property
    def placemap(self) -> Map:
        """The shown version of the map."""
        return self._shown.placemap

    @property
    def columns(self) -> DistanceColumns:
        """The columns of the distances of its answers."""
        return self._shown.columns

    @property
    def ending(self) -> str:
        """How the last answered stream ended, in words; empty while it has not."""
        if self.ended is None:
            return ""
        by_hand = self._stopped == self.ended.stream
        return "stopped by hand" if by_hand else "the stream is over"

    def note_stop(self) -> None:
        """Note that the source of the last answered stream is being stopped by hand."""
        if self.answers and self.ended is None:
            self._stopped = self.answers[-1].header.stream

    def offer(self, version: ShownMap) -> None:
        """Take a new version of the map, to be shown from its first match on."""
        self._next = version

    def _show(self, version: ShownMap) -> None:
        """Show a new version; the answers of the old one have other places, and are left out."""
        self._shown, self._next, self.summary = version, None, None
        self._smoothed.clear()
        self._numbers.clear()
        self.answers.clear()
        self._under_way.clear()

    def add_frame(self, header: Header, payload: bytes) -> None:
        """Add a frame; it is decoded only when it is shown."""
        if header.end:
            return
        self._frame_bytes -= len(self._frames.pop(_key(header), b""))
        self._frames[_key(header)] = payload
        self._frame_bytes += len(payload)
        most = KEPT + _UNDER_WAY
        while len(self._frames) > most or (
            self._frame_bytes > _KEPT_BYTES and len(self._frames) > 1
        ):
            _, oldest = self._frames.popitem(last=False)
            self._frame_bytes -= len(oldest)

    def add_feature(self, header: Header, payload: bytes) -> None:
        """Add the descriptor of a frame.

        Raises:
            MessageError: the payload is not a descriptor message.
        """
        if header.end:
            return
        feature = FeatureMessage.decode(payload)
        if feature.model != self._model:
            self.counts["foreign"] += 1
        elif feature.descriptor is not None:
            try:
                self._descriptors.checked(feature.descriptor)
            except FrameError as error:
                raise MessageError(str(error)) from None
            self._of(header).distances = self.columns.row(feature.descriptor)

    def add_candidates(self, header: Header, payload: bytes) -> None:
        """Add the candidates that a worker's channels, or shards of them, have for a frame.

        Raises:
            MessageError: the payload is not a candidates message.
        """
        if header.end:
            return
        message = CandidatesMessage.decode(payload)
        if self._is_foreign(message.map):
            return
        under_way = self._of(header)
        if under_way.shards is None or under_way.rule != message.rule:
            under_way.rule, under_way.shards = message.rule, ShardJoiner(message.rule)
        for candidate in message.candidates:
            self._check(candidate, message.rule)
            joined = under_way.shards.add(
                header.sequence,
                candidate.channel,
                message.shard,
                message.shards,
                candidate.candidate,
            )
            if joined is not None:
                under_way.candidates[candidate.channel] = thinned(joined, message.rule)

    def _is_foreign(self, digest: str) -> bool:
        if digest == self.placemap.digest:
            return False
        # Before a new version answers, its candidates come, too.
        self.counts["foreign"] += self._next is None or digest != self._next.placemap.digest
        return True

    def _check(self, candidate: ChannelCandidate, rule: Rule) -> None:
        if rule == "filter" and len(candidate.places) != len(candidate.evidence):
            raise MessageError(f"channel {candidate.channel}: needs one evidence for each place")
        if candidate.place >= self.placemap.places.count:
            self.counts["foreign"] += 1

    def add_match(self, header: Header, payload: bytes) -> None:
        """Add the match of a frame; a match that was added before is skipped.

        Raises:
            MessageError: the payload is not a match message.
        """
        if header.end:
            self.ended = header
            return
        match = MatchMessage.decode(payload)
        if self._next is not None and match.map == self._next.placemap.digest:
            self._show(self._next)
        if self._is_foreign(match.map):
            self.foreign_map = match.map
            return
        self.foreign_map = None
        last = self.answers[-1] if self.answers else None
        gap = 0
        if last is not None and last.header.stream == header.stream:
            gap = header.sequence - last.header.sequence - 1
            if gap < 0:
                return
        self._append(header, match, 0 if header.live else gap)

    def _append(self, header: Header, match: MatchMessage, missed: int) -> None:
        self.counts["missed"] += missed
        of = self._under_way.pop(_key(header), _UnderWay())
        if len(self.answers) == KEPT:
            del self._numbers[_key(self.answers[0].header)]
        answer = Answer(self._answered, header, match, of.rule, of.candidates, of.distances)
        self.answers.append(answer)
        self._numbers[_key(header)] = answer.number
        self._answered += 1
        self.ended = None
        if self.summary is None or self.summary.stream != header.stream:
            self.summary = StreamSummary(header.stream, self._tolerance)
        self.summary.add(answer, missed)
        self._compare(answer)

    def add_smoothed(self, header: Header, payload: bytes) -> None:
        """Add the smoothed match of a frame; a match that was added before is skipped.

        Raises:
            MessageError: the payload is not a smoothed match.
        """
        if header.end:
            return
        smoothed = SmoothedMessage.decode(payload)
        if self._is_foreign(smoothed.map) or _key(header) in self._smoothed:
            return
        self._smoothed[_key(header)], self.newest_smoothed = smoothed, header
        if len(self._smoothed) > KEPT + _UNDER_WAY:
            self._smoothed.popitem(last=False)
        number = self._numbers.get(_key(header))
        answer = None if number is None else self.at(number)
        if answer is not None:
            self._compare(answer)

    def _compare(self, answer: Answer) -> None:
        """Compare the first match of a frame with its smoothed one, once there are both."""
        smoothed, summary = self.smoothed(answer), self.summary
        if smoothed and summary and summary.stream == answer.header.stream:
            summary.compare(answer.header, answer.match, smoothed)

    def smoothed(self, answer: Answer) -> SmoothedMessage | None:
        """Return the smoothed match of an answered frame, if it has come and is kept."""
        return self._smoothed.get(_key(answer.header))

    def at(self, number: int) -> Answer | None:
        """Return the answer with this number; None if it is not kept."""
        if not self.answers:
            return None
        place = number - self.answers[0].number
        return self.answers[place] if 0 <= place < len(self.answers) else None

    def before(self, answer: Answer, frames: int) -> list[Answer]:
        """Return the kept answers of the last ``frames`` frames of a stream, up to this answer."""
        first = answer.header.sequence - frames
        found = [
            one
            for one in self._backwards_from(answer)
            if one.header.stream == answer.header.stream and one.header.sequence > first
        ]
        return found[::-1]

    def last_seconds(self, answer: Answer, seconds: float) -> list[Answer]:
        """Return the kept answers of a stream's last seconds, by its clock, up to this answer."""
        since = answer.header.stamp_ns - seconds * 1e9
        return [one for one in self.before(answer, KEPT) if one.header.stamp_ns >= since]

    def _backwards_from(self, answer: Answer) -> Iterator[Answer]:
        return (one for one in reversed(self.answers) if one.number <= answer.number)

    def frame(self, answer: Answer) -> bytes | None:
        """Return the frame message of an answer; None if it is not kept."""
        return self._frames.get(_key(answer.header))

    def _of(self, header: Header) -> _UnderWay:
        under_way = self._under_way.setdefault(_key(header), _UnderWay())
        if len(self._under_way) > _UNDER_WAY:
            self._under_way.popitem(last=False)
        return under_way


def _key(header: Header) -> _Key:
    return header.stream, header.sequence
