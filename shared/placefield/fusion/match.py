"""The fuser's match of one query frame."""

from dataclasses import dataclass

from placefield.notebook import html_of_match
from placefield.pose import Pose

FASTER = "faster than the map resolves"
"""The words for a match that is ``too_fast``, the same everywhere."""


@dataclass(frozen=True)
class Match:
    """The place of a query frame.

    Attributes:
        place: index of the place, or ``UNANSWERED``.
        score: the higher the more certain. Under ``filter`` the log odds that the vehicle is within
            the tolerance of the place; under ``evidence`` the margin to the best place outside the
            match's neighbourhood, in deviations; under ``ams`` the negated fine score.
        missing: channels that did not answer in time.
        probability: that the vehicle is within the tolerance of the place; only under ``filter``.
        known: whether the probability is at least the configured precision, so that one may act on
            the match; only under ``filter``.
        too_fast: whether the vehicle most likely moves faster than the map resolves, so that its
            place is not known; only under ``filter``.
        forgotten: whether services lost the state of the stream and no other service could restore
            it: the match may differ from that of an undisturbed stream.
        pose: of the place, in the map's frame; None if there is no place, or its pose is unknown.
        new: that the frame shows no earlier place of its drive; only where a drive is explored, and
            then ``place`` is the number of an earlier frame.
    """

    place: int
    score: float
    missing: tuple[int, ...] = ()
    probability: float | None = None
    known: bool | None = None
    too_fast: bool = False
    forgotten: bool = False
    pose: Pose | None = None
    new: float | None = None

    def _repr_html_(self) -> str:
        return html_of_match(self)


@dataclass(frozen=True)
class SmoothedMatch:
    """The place of a query frame, given later frames.

    Attributes:
        frame: number of the frame in its stream, from 0.
        match: its place.
        lag: number of later frames that it uses.
    """

    frame: int
    match: Match
    lag: int
