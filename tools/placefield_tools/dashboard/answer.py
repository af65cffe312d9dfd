"""A frame of a run with its answer."""

from dataclasses import dataclass

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.config import Rule
from placefield.matching.candidate import Candidate
from placefield_tools.dashboard.distance_columns import Row


@dataclass(frozen=True, eq=False)
class Answer:
    """An answered frame.

    Attributes:
        number: number of the answer, from 0, across all streams.
        header: header of the frame.
        match: match of the frame.
        rule: rule that made the channels' candidates; None if no candidate came.
        candidates: candidate by channel, see ``thinned``.
        distances: distances to the places, in the columns of ``DistanceColumns``; None if no
            descriptor of this map came.
    """

    number: int
    header: Header
    match: MatchMessage
    rule: Rule | None
    candidates: dict[int, Candidate]
    distances: Row | None
