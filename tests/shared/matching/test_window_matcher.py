"""What frames are smoothed with: the mirror image in time and place of the answers at once."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from windowed import Windowed

from placefield.matching.ams import AmsMatcher
from placefield.matching.candidate import Candidate
from placefield.matching.evidence import EvidenceMatcher
from placefield.matching.matcher import SmoothedCandidate
from placefield.matching.window_matcher import WindowMatcher

Frames = list[NDArray[np.int32] | None]
ALL_LAGS = 1000

rules = pytest.mark.parametrize("rule", [EvidenceMatcher, AmsMatcher])
scales = st.lists(st.integers(1, 9), min_size=1, max_size=4, unique=True).map(sorted)


@st.composite
def streams(draw: st.DrawFn, missing: bool = True) -> Frames:
    """Distances (K,) of each frame, None for a missing one; of few values, so that ties come."""
    frames, places = draw(st.integers(0, 40)), draw(st.integers(1, 15))
    most = draw(st.sampled_from([2, 1_000_000]))
    D = np.random.default_rng(draw(st.integers(0, 999))).integers(0, most, (frames, places))
    observed = draw(st.lists(st.booleans() if missing else st.just(True), min_size=40, max_size=40))
    return [
        row.astype(np.int32) if there else None for row, there in zip(D, observed, strict=False)
    ]


def places_of(frames: Frames) -> int:
    return next((len(frame) for frame in frames if frame is not None), 5)


def mirrored(frames: Frames) -> Frames:
    """The stream in reverse, on the map in reverse."""
    return [None if frame is None else frame[::-1].copy() for frame in reversed(frames)]


def bits(candidate: Candidate) -> tuple[int, float, bytes]:
    return candidate.place, candidate.score, candidate.evidence.tobytes()


def smooth(
    rule: type[WindowMatcher], lengths: list[int], frames: Frames, lag: int
) -> list[SmoothedCandidate]:
    return Windowed(rule, lengths, places_of(frames), lag=lag).smooth_all(frames)


def at_once(rule: type[WindowMatcher], lengths: list[int], frames: Frames) -> list[Candidate]:
    return Windowed(rule, lengths, places_of(frames)).update_all(frames)


@rules
@given(scales, streams(missing=False))
@settings(max_examples=60)
def test_a_stream_is_smoothed_as_its_mirror_image_is_answered_at_once(
    rule: type[WindowMatcher], lengths: list[int], frames: Frames
) -> None:
    answers = at_once(rule, lengths, mirrored(frames))[::-1]
    smoothed = smooth(rule, lengths, frames, ALL_LAGS)
    reversed = [each.reversed(places_of(frames)) for each in answers]
    assert [bits(each.candidate) for each in smoothed] == [bits(each) for each in reversed]


@rules
@given(scales, streams(), st.integers(1, 12))
@settings(max_examples=60)
def test_a_frame_is_smoothed_by_the_mirror_image_of_the_frames_that_it_waits_for(
    rule: type[WindowMatcher], lengths: list[int], frames: Frames, lag: int
) -> None:
    """Whatever is missing; the last of them counts as the stream's end, and longer windows are cut.

    So what comes after the lag changes nothing.
    """
    cut = [min(length, lag + 1) for length in lengths]
    smoothed = smooth(rule, lengths, frames, lag)
    assert len(smoothed) == len(frames)
    for number, each in enumerate(smoothed):
        waited_for = frames[number : number + max(cut)]
        windows = Windowed(rule, cut, places_of(frames))
        expected = windows.update_all(mirrored(waited_for))[-1].reversed(places_of(frames))
        assert bits(each.candidate) == bits(expected)
        assert each.lag == len(waited_for) - 1 <= lag


@rules
@given(scales, streams())
@settings(max_examples=20)
def test_with_no_lag_frames_are_smoothed_as_they_are_answered(
    rule: type[WindowMatcher], lengths: list[int], frames: Frames
) -> None:
    smoothed = smooth(rule, lengths, frames, 0)
    answers = at_once(rule, lengths, frames)
    assert [bits(each.candidate) for each in smoothed] == [bits(each) for each in answers]
    assert {each.lag for each in smoothed} <= {0}


@rules
@given(scales, streams(), st.integers(1, 12))
@settings(max_examples=20)
def test_a_lag_changes_not_one_bit_of_the_answers_at_once(
    rule: type[WindowMatcher], lengths: list[int], frames: Frames, lag: int
) -> None:
    smoothed = Windowed(rule, lengths, places_of(frames), lag=lag).update_all(frames)
    expected = at_once(rule, lengths, frames)
    assert [bits(each) for each in smoothed] == [bits(each) for each in expected]


@rules
def test_a_frame_is_smoothed_when_its_longest_window_is_complete(rule: type[WindowMatcher]) -> None:
    D = np.random.default_rng(0).integers(0, 1000, (10, 30), np.int32)
    for lag, waits in ((1, 1), (3, 3), (4, 4), (20, 4)):
        windows = Windowed(rule, [2, 5], 30, lag=lag)
        lags = []
        for row in D:
            windows.update(row)
            lags.append([each.lag for each in windows.matcher.smoothed()])
        assert lags == [[]] * waits + [[waits]] * (10 - waits)
        assert len(windows.finish()) == waits
