"""What the matches of a stream come to, and which of them later frames corrected."""

from collections import deque
from dataclasses import dataclass

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.maps.route_graph import RouteGraph
from placefield_tools.common.natural_sort import counted
from placefield_tools.common.place_words import place_words

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
        last: number of its last frame so far.
    """

    first: int
    last: int

    @property
    def middle(self) -> int:
        """The number of the frame in its middle."""
        return (self.first + self.last) // 2

    def words(self) -> str:
        """Say which frames these are."""
        if self.first == self.last:
            return f"not known: frame {self.first}"
        return f"not known: frames {self.first} to {self.last}"


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
        self._is_lost = False

    def add(self, sequence: int, match: MatchMessage, missed: int) -> None:
        """Count the first match of a frame, and the frames missed before it."""
        self.frames += 1
        if match.known is not None:
            self.known = (self.known or 0) + match.known
        self.missed += missed
        if match.known is False:
            first = self.lost.pop().first if self._is_lost else sequence
            self.lost.append(Lost(first, sequence))
        self._is_lost = match.known is False

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
            parts += [f"{self.known} known at once", f"{self.corrected or 'none'} corrected later"]
        parts.append(f"{self.missed} missed" if self.missed else "no gap")
        return ", ".join(parts)
