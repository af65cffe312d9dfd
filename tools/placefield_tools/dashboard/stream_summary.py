"""What the matches of a stream come to, and which of them later frames corrected."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.maps.route_graph import RouteGraph
from placefield_tools.common.natural_sort import counted
from placefield_tools.common.place_words import place_words
from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.verdict import Kind, verdict_name

_SHOWN = 50  # corrections, and stretches, that are kept


@dataclass(frozen=True)
class Correction:
    """A match that later frames corrected.

    Attributes:
        header: of the frame.
        first: the match from the frames up to this one.
        smoothed: the match that also uses later frames.
    """

    header: Header
    first: MatchMessage
    smoothed: SmoothedMessage

    def words(self, graph: RouteGraph | None) -> str:
        """Say what was corrected, and when."""
        later = f"{counted(self.smoothed.lag, 'frame')} later"
        now, before = (place_words(one.place, graph) for one in (self.smoothed, self.first))
        if not self.smoothed.known:
            return f"frame {self.header.sequence}: {before} no longer known, {later}"
        if not self.first.known:
            return f"frame {self.header.sequence}: {now} now known, {later}"
        return f"frame {self.header.sequence}: {now} instead of {before}, {later}"


@dataclass(frozen=True)
class Lost:
    """A stretch of frames that are not known, between frames that are.

    Attributes:
        first: number of its first frame.
        last: number of its last frame.
        verdicts: how many frames have each verdict, by its name, in the order of their coming.
    """

    first: int
    last: int
    verdicts: Mapping[str, int]

    @property
    def middle(self) -> int:
        """The number of the frame in its middle."""
        return (self.first + self.last) // 2

    @property
    def kind(self) -> Kind:
        """How it is marked: as likely, if all of it is."""
        return "likely" if set(self.verdicts) == {"likely"} else "unknown"

    def words(self) -> str:
        """Say which frames these are, and their verdicts, the most frequent first."""
        is_one = self.first == self.last
        frames = f"frame {self.first}" if is_one else f"frames {self.first} to {self.last}"
        ranked = sorted(self.verdicts.items(), key=lambda each: -each[1])
        if len(ranked) == 1:
            return f"{frames}: {ranked[0][0]}"
        return f"{frames}: " + ", ".join(f"{count} {name}" for name, count in ranked)


class StreamSummary:
    """Counts the answers of one stream.

    Attributes:
        frames: how many have a first match.
        known: how many of these are known; None if the rule does not say.
        missed: how many of a lossless stream were not received.
        corrected: how many first matches later frames corrected.
        corrections: the last of these, oldest first.
        lost: the last stretches of frames that are not known, oldest first.
    """

    def __init__(self, stream: str, tolerance: int) -> None:
        """Begin a stream; places up to ``tolerance`` apart count as the same."""
        self.stream, self._tolerance = stream, tolerance
        self.frames = self.missed = self.corrected = 0
        self.known: int | None = None
        self.corrections: deque[Correction] = deque(maxlen=_SHOWN)
        self.lost: deque[Lost] = deque(maxlen=_SHOWN)
        self._is_lost = self._is_live = False

    def add(self, answer: Answer, missed: int) -> None:
        """Count the first match of a frame, and the frames missed before it."""
        known, sequence = answer.match.known, answer.header.sequence
        self._is_live = answer.header.live
        self.frames += 1
        if known is not None:
            self.known = (self.known or 0) + known
        self.missed += missed
        if known is False:
            name = verdict_name(answer)
            so_far = self.lost.pop() if self._is_lost else Lost(sequence, sequence, {})
            verdicts = {**so_far.verdicts, name: so_far.verdicts.get(name, 0) + 1}
            self.lost.append(Lost(so_far.first, sequence, verdicts))
        self._is_lost = known is False

    def compare(self, header: Header, first: MatchMessage, smoothed: SmoothedMessage) -> None:
        """Count the frame if its smoothed match corrects its first match.

        A first match is corrected if it was known and is not, or the other way round, or if it is
        known at another place.
        """
        moved = abs(first.place - smoothed.place) > self._tolerance
        if bool(first.known) != bool(smoothed.known) or (smoothed.known and moved):
            self.corrected += 1
            self.corrections.append(Correction(header, first, smoothed))

    def words(self) -> str:
        """Say what the stream came to."""
        parts = [counted(self.frames, "frame")]
        if self.known is not None:
            unknown = self.frames - self.known
            parts.append(f"{self.known} known at once")
            parts += [f"{unknown} not known"] if unknown else []
            parts.append(f"{self.corrected or 'none'} corrected later")
        if self.missed or not self._is_live:
            missed = f"{counted(self.missed, 'frame')} not received"
            parts.append(missed if self.missed else "all received")
        return ", ".join(parts)
