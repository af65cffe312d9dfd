import pytest

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.maps.digest import NO_DIGEST
from placefield_tools.dashboard.stream_summary import StreamSummary


def first(place: int, *, known: bool | None) -> MatchMessage:
    return MatchMessage(map=NO_DIGEST, place=place, score=1.0, known=known)


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


def test_a_stream_is_summed_up_in_words() -> None:
    summary = StreamSummary("s", tolerance=3)
    summary.add(0, first(1, known=False), 0)
    summary.add(1, first(2, known=True), 0)
    assert summary.words() == "2 frames, 1 known at once, none corrected later, no gap"
    summary.add(5, first(6, known=True), 3)
    summary.compare(HEADER, first(9, known=True), later(40, known=True))
    assert summary.words() == "3 frames, 2 known at once, 1 corrected later, 3 missed"


def test_a_rule_that_does_not_say_known_is_not_summed_up_so() -> None:
    summary = StreamSummary("s", tolerance=3)
    summary.add(0, first(1, known=None), 0)
    assert summary.words() == "1 frame, no gap"


def test_the_stretches_that_are_not_known_are_listed() -> None:
    summary = StreamSummary("s", tolerance=3)
    for sequence, known in enumerate([False, False, True, False, True, True, False]):
        summary.add(10 + sequence, first(sequence, known=known), 0)
    summary.add(30, first(9, known=False), 13)
    assert [(one.words(), one.middle) for one in summary.lost] == [
        ("not known: frames 10 to 11", 10),
        ("not known: frame 13", 13),
        ("not known: frames 16 to 30", 23),
    ]
