"""What came on the bus to what is shown: the newest answers, each with what it was made of.

Pure: it is told what was received, and draws nothing.
"""

from collections import Counter, OrderedDict, deque
from collections.abc import Iterator
from dataclasses import dataclass, field

from placefield.bus.candidate_messages import CandidatesMessage, ChannelCandidate
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage, MatchMessage, SmoothedMessage
from placefield.config import Rule
from placefield.errors import FrameError, MessageError
from placefield.fusion.shards import ShardJoiner
from placefield.maps.map import Map, fingerprint
from placefield.matching.candidate import Candidate
from placefield_tools.common.certainty import certainty_of
from placefield_tools.dashboard.distances import DistanceColumns, Row
from placefield_tools.dashboard.fields import thinned

KEPT = 600
"""Answers that one may look back over."""

_KEPT_BYTES = 64 * 2**20  # of their frames, as they came
_UNDER_WAY = 256  # frames that are not answered yet


@dataclass(frozen=True, eq=False)
class Answer:
    """A frame that was answered.

    Attributes:
        number: of the answer, from 0, whatever its stream.
        header: of the frame.
        match: its match.
        rule: by which the channels' candidates were made; none where none came.
        candidates: by channel, see ``thinned``.
        distances: to the places, in the columns of ``DistanceColumns``; none where no descriptor
            of this map came.
    """

    number: int
    header: Header
    match: MatchMessage
    rule: Rule | None
    candidates: dict[int, Candidate]
    distances: Row | None

    @property
    def verdict(self) -> str:
        """What the match comes to, in a few words."""
        if self.match.place < 0:
            return "no answer"
        return certainty_of(self.match) or "matched"


@dataclass
class _UnderWay:
    """What came of a frame so far."""

    rule: Rule | None = None
    shards: ShardJoiner | None = None
    candidates: dict[int, Candidate] = field(default_factory=dict)
    distances: Row | None = None


_Key = tuple[str, int]  # stream and sequence


class LiveState:
    """The newest answers of a run; bounded, however fast they come.

    Counts answers that were ``missed`` between two of a stream that drops none, and messages that
    are ``foreign``: of another map than this one. They are not shown.
    """

    def __init__(self, placemap: Map) -> None:
        self.answers: deque[Answer] = deque(maxlen=KEPT)
        self.counts: Counter[str] = Counter()
        self.ended: Header | None = None
        """The end of the stream that was answered last, if it is over."""
        self.smoothed: tuple[Header, SmoothedMessage] | None = None
        """The newest smoothed match, of the stream that was smoothed last."""
        self.columns = DistanceColumns(placemap)
        self.digest = placemap.digest
        """Which map is shown."""
        self._model = fingerprint(placemap.model)
        self._descriptors = placemap.model
        self._places = placemap.places.count
        self._under_way: OrderedDict[_Key, _UnderWay] = OrderedDict()
        self._frames: OrderedDict[_Key, bytes] = OrderedDict()
        self._frame_bytes = 0

    def take_frame(self, header: Header, payload: bytes) -> None:
        """Take a frame; it is looked at only when it is shown."""
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

    def take_feature(self, header: Header, payload: bytes) -> None:
        """Take the descriptor of a frame.

        Raises:
            MessageError: it is none.
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

    def take_candidates(self, header: Header, payload: bytes) -> None:
        """Take what a worker's channels, or shards of them, say of a frame.

        Raises:
            MessageError: it is no such thing.
        """
        if header.end:
            return
        message = CandidatesMessage.decode(payload)
        if self._is_foreign(message.map):
            return
        under_way = self._of(header)
        if under_way.shards is None or under_way.rule != message.rule:
            under_way.rule, under_way.shards = message.rule, ShardJoiner(message.rule)
        for told in message.candidates:
            self._check(told, message.rule)
            joined = under_way.shards.add(
                header.sequence, told.channel, message.shard, message.shards, told.candidate
            )
            if joined is not None:
                under_way.candidates[told.channel] = thinned(joined, message.rule)

    def _is_foreign(self, digest: str) -> bool:
        if digest == self.digest:
            return False
        self.counts["foreign"] += 1
        return True

    def _check(self, told: ChannelCandidate, rule: Rule) -> None:
        if rule == "filter" and len(told.places) != len(told.evidence):
            raise MessageError(f"channel {told.channel}: evidence is not of its places")
        if told.place >= self._places:
            self.counts["foreign"] += 1

    def take_match(self, header: Header, payload: bytes) -> None:
        """Take the match of a frame; what was answered before is sent again at times.

        Raises:
            MessageError: it is none.
        """
        if header.end:
            self.ended = header
            return
        match = MatchMessage.decode(payload)
        if self._is_foreign(match.map):
            return
        last = self.answers[-1] if self.answers else None
        if last is not None and last.header.stream == header.stream:
            ahead = header.sequence - last.header.sequence - 1
            if ahead < 0:
                return
            if not header.live:
                self.counts["missed"] += ahead
        of = self._under_way.pop(_key(header), _UnderWay())
        number = 0 if last is None else last.number + 1
        self.answers.append(Answer(number, header, match, of.rule, of.candidates, of.distances))
        self.ended = None

    def take_smoothed(self, header: Header, payload: bytes) -> None:
        """Take the smoothed match of a frame; one that is not newer came before.

        Raises:
            MessageError: it is none.
        """
        if header.end:
            return
        smoothed = SmoothedMessage.decode(payload)
        if self._is_foreign(smoothed.map):
            return
        last = self.smoothed[0] if self.smoothed else None
        if last is None or last.stream != header.stream or last.sequence < header.sequence:
            self.smoothed = header, smoothed

    def at(self, number: int) -> Answer | None:
        """Return the answer of this number, if it is kept."""
        if not self.answers:
            return None
        place = number - self.answers[0].number
        return self.answers[place] if 0 <= place < len(self.answers) else None

    def before(self, answer: Answer, frames: int) -> list[Answer]:
        """Return the answers of a stream that are kept of so many frames, up to this one's."""
        first = answer.header.sequence - frames
        found = [
            one
            for one in self._backwards_from(answer)
            if one.header.stream == answer.header.stream and one.header.sequence > first
        ]
        return found[::-1]

    def _backwards_from(self, answer: Answer) -> Iterator[Answer]:
        return (one for one in reversed(self.answers) if one.number <= answer.number)

    def frame(self, answer: Answer) -> bytes | None:
        """Return the message that the frame came in, if it is kept."""
        return self._frames.get(_key(answer.header))

    def _of(self, header: Header) -> _UnderWay:
        under_way = self._under_way.setdefault(_key(header), _UnderWay())
        if len(self._under_way) > _UNDER_WAY:
            self._under_way.popitem(last=False)
        return under_way


def _key(header: Header) -> _Key:
    return header.stream, header.sequence
