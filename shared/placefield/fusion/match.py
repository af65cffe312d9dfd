"""What the fuser says of one query frame."""

from dataclasses import dataclass

from placefield.notebook import html_of_match
from placefield.pose import Pose

FASTER = "faster than the map resolves"
"""What is told of a match that is ``too_fast``, everywhere in the same words."""


@dataclass(frozen=True)
class Match:
    """Where the query frame was taken.

    Attributes:
        place: index of the place, or ``UNANSWERED``.
        score: the higher the more certain. Under ``filter`` the log odds that the vehicle is within
            the tolerance of the place; under ``evidence`` the margin to the best place outside
            the match's neighbourhood, in deviations; under ``lowest-score`` the negated fine score.
        missing: channels that did not answer in time.
        probability: that the vehicle is within the tolerance of the place; only ``filter`` tells.
        known: whether that is likely enough, by the precision asked for, to act on.
        too_fast: whether the vehicle most likely moves faster than the map resolves: then the match
            is not known, for nobody knows where it is; only ``filter`` tells.
        forgotten: whether services have begun the stream anew in its midst, and nobody remembered
            enough of it: the match may differ from that of a stream that was never disturbed.
        pose: of the place, in the map's frame; None where there is no place, or nobody knows it.
    """

    place: int
    score: float
    missing: tuple[int, ...] = ()
    probability: float | None = None
    known: bool | None = None
    too_fast: bool = False
    forgotten: bool = False
    pose: Pose | None = None

    def _repr_html_(self) -> str:
        return html_of_match(self)


@dataclass(frozen=True)
class SmoothedMatch:
    """Where a query frame was taken, given frames after it.

    Attributes:
        frame: number of the frame in its stream, from 0.
        match: where it was taken.
        lag: how many frames after it are known.
    """

    frame: int
    match: Match
    lag: int
