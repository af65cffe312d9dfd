import numpy as np
import pytest

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.maps.digest import NO_DIGEST
from placefield.matching.candidate import Candidate
from placefield_tools.dashboard.answer import Answer
from placefield_tools.dashboard.stream_summary import StreamSummary


def first(place: int, *, known: bool | None, probability: float | None = None) -> MatchMessage:
    return MatchMessage(map=NO_DIGEST, place=place, score=1.0, known=known, probability=probability)


def later(place: int, *, known: bool) -> SmoothedMessage:
    return SmoothedMessage(map=NO_DIGEST, place=place, score=1.0, known=known, lag=12)


HEADER = Header(stream="s", sequence=57, stamp_ns=0)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (first(9, known=True), later(12, known=True), None),  # within the tolerance
        (first(9, known=False), later(40, known=False), None),  # neither is acted on
        (
            first(9, known=True),
            later(40, known=True),
            "frame 57: place 40 instead of place 9, 12 frames later",
        ),
        (
            first(9, known=False),
            later(9, known=True),
            "frame 57: place 9 now known, 12 frames later",
        ),
        (
            first(9, known=True),
            later(9, known=False),
            "frame 57: place 9 no longer known, 12 frames later",
        ),
    ],
)
def test_a_correction_says_what_later_frames_changed(
    before: MatchMessage, after: SmoothedMessage, words: str | None
) -> None:
    summary = StreamSummary("s", tolerance=3)
    summary.compare(HEADER, before, after)
    assert [each.words(None) for each in summary.corrections] == ([] if words is None else [words])
    assert summary.corrected == len(summary.corrections)


def add(
    summary: StreamSummary,
    sequence: int,
    match: MatchMessage,
    *,
    missed: int = 0,
    belief: float = 1.0,
    live: bool = False,
) -> None:
    """Add a frame's answer, with so much belief in the map's places."""
    header = Header(stream="s", sequence=sequence, stamp_ns=0, live=live)
    evidence = np.array([belief], np.float32)
    candidate = Candidate(match.place, belief, np.array([match.place], np.int32), evidence)
    summary.add(Answer(0, header, match, "filter", {0: candidate}, None), missed)


def test_a_stream_is_summed_up_in_words() -> None:
    summary = StreamSummary("s", tolerance=3)
    add(summary, 0, first(1, known=False))
    add(summary, 1, first(2, known=True))
    assert summary.words() == (
        "2 frames, 1 known at once, 1 not known, none corrected later, all received"
    )
    add(summary, 5, first(6, known=True), missed=3)
    summary.compare(HEADER, first(9, known=True), later(40, known=True))
    assert summary.words() == (
        "3 frames, 2 known at once, 1 not known, 1 corrected later, 3 frames not received"
    )


def test_a_rule_that_does_not_say_known_is_not_summed_up_so() -> None:
    summary = StreamSummary("s", tolerance=3)
    add(summary, 0, first(1, known=None))
    assert summary.words() == "1 frame, all received"


def test_a_live_stream_drops_frames_and_misses_none() -> None:
    summary = StreamSummary("s", tolerance=3)
    add(summary, 0, first(1, known=None), live=True)
    assert summary.words() == "1 frame"


def test_the_stretches_that_are_not_known_are_listed_with_their_verdicts() -> None:
    summary = StreamSummary("s", tolerance=3)
    likely = first(9, known=False, probability=0.9)
    unknown = first(9, known=False, probability=0.1)
    add(summary, 10, unknown, belief=0.1)
    add(summary, 11, first(9, known=True))
    add(summary, 12, likely)
    add(summary, 13, likely)
    add(summary, 14, first(9, known=True))
    add(summary, 26, likely, missed=11)
    add(summary, 27, unknown)
    for sequence in (28, 30):
        add(summary, sequence, unknown, belief=0.1)
    assert [(one.words(), one.middle, one.kind) for one in summary.lost] == [
        ("frame 10: looking for the place", 10, "unknown"),
        ("frames 12 to 13: likely", 12, "likely"),
        ("frames 26 to 30: 2 not on this route, 1 likely, 1 unknown", 28, "unknown"),
    ]
