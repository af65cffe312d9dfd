"""What the fuser says of one query frame."""

from dataclasses import dataclass


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
    """

    place: int
    score: float
    missing: tuple[int, ...] = ()
    probability: float | None = None
    known: bool | None = None


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
