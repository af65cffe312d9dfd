"""The published rule against Eqs. 11 to 16, written out index by index.

The smoothed answer is the paper's, whose windows begin at the query frame and at its answer; the
answer at once is its mirror image in time and place.
"""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from windowed import Windowed

from placefield.config import MatchingConfig
from placefield.fusion.rules import fuse
from placefield.matching.ams import AmsMatcher
from placefield.matching.candidate import NO_CANDIDATE, UNANSWERED

Array = NDArray[np.int32]
Scored = tuple[float, int]


def reference_hypothesis(D: Array, smallest: int, coarse: int) -> Scored:
    """Eqs. 11 to 14: F(Y) and Y of the last row of D (query frames, places), at a coarse scale."""
    newest, places = len(D) - 1, D.shape[1]
    F_H, H = float("inf"), -1
    for q in range(places - coarse + 1):
        F = 0
        for i in range(coarse):
            F += int(D[newest - coarse + 1 + i, q + i])
        if F < F_H:
            F_H, H = F, q
    F_Y, Y = float("inf"), -1
    for t in range(H, H + coarse - smallest + 1):
        F = 0
        for i in range(smallest):
            F += int(D[newest - smallest + 1 + i, t + i])
        if F < F_Y:
            F_Y, Y = F, t
    return F_Y, Y + smallest - 1


def reference_candidate(D: Array, scales: list[int]) -> Scored | None:
    """Eq. 15, over the coarse scales that the query and the map are long enough for."""
    smallest, coarse_scales = scales[0], scales[1:] or scales
    best: Scored | None = None
    for coarse in coarse_scales:
        if coarse <= len(D) and coarse <= D.shape[1]:
            hypothesis = reference_hypothesis(D, smallest, coarse)
            if best is None or hypothesis[0] < best[0]:
                best = hypothesis
    return best


def reference_match(channels: list[tuple[Array, list[int]]]) -> Scored | None:
    """Eq. 16."""
    best: Scored | None = None
    for D, scales in channels:
        candidate = reference_candidate(D, scales)
        if candidate is not None and (best is None or candidate[0] < best[0]):
            best = candidate
    return best


@st.composite
def streams(draw: st.DrawFn) -> list[tuple[Array, list[int]]]:
    """Each channel's distances (query frames, places) and scales; coarse values, so that ties come.

    One in two has a smooth valley of low distances along a diagonal, as a true match has.
    """
    # A query of many frames makes the columns of the sums come around.
    frames, places = draw(st.integers(1, 60)), draw(st.integers(1, 25))
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    levels = draw(st.sampled_from([2, 5, 1_000_000]))
    off_route = np.abs(np.arange(places) - np.arange(frames)[:, None] - rng.integers(0, 9))
    valley = draw(st.booleans()) * levels * np.minimum(off_route, 5)
    channels = []
    for _ in range(draw(st.integers(1, 3))):
        D = valley + rng.integers(0, levels, (frames, places))
        scales = draw(st.lists(st.integers(2, 12), min_size=1, max_size=4, unique=True).map(sorted))
        channels.append((D.astype(np.int32), scales))
    return channels


@given(streams())
def test_places_and_scores_are_those_of_the_equations(
    channels: list[tuple[Array, list[int]]],
) -> None:
    frames, places = channels[0][0].shape
    windows = [Windowed(AmsMatcher, scales, places, unit=0.25) for _, scales in channels]
    for newest in range(frames):
        candidates = []
        for channel, (D, scales) in zip(windows, channels, strict=True):
            candidate = channel.update(D[newest])
            expected = reference_candidate(D[: newest + 1], scales)
            if expected is None:
                assert candidate is NO_CANDIDATE
            else:
                assert (candidate.score * 16, candidate.place) == expected
            candidates.append(candidate)
        match = fuse(candidates, MatchingConfig(rule="ams"))
        expected = reference_match([(D[: newest + 1], scales) for D, scales in channels])
        if expected is None:
            assert match.place == UNANSWERED
        else:
            assert (-match.score * 16, match.place) == expected


def published_hypothesis(D: Array, smallest: int, coarse: int) -> Scored:
    """Eqs. 11 to 14: F(Y) and Y of the first row of D; of several minima the last is taken."""
    F_H, H = float("inf"), -1
    for q in range(D.shape[1] - coarse + 1):
        F = sum(int(D[j - q, j]) for j in range(q, q + coarse))
        if F <= F_H:
            F_H, H = F, q
    F_Y, Y = float("inf"), -1
    for t in range(H, H + coarse - smallest + 1):
        F = sum(int(D[j - t, j]) for j in range(t, t + smallest))
        if F <= F_Y:
            F_Y, Y = F, t
    return F_Y, Y


def published_match(channels: list[tuple[Array, list[int]]]) -> Scored | None:
    """Eqs. 15 and 16, over the coarse scales that the query and the map are long enough for."""
    hypotheses = [
        published_hypothesis(D, scales[0], coarse)
        for D, scales in channels
        for coarse in (scales[1:] or scales)
        if coarse <= min(D.shape)
    ]
    return min(hypotheses, key=lambda scored: scored[0], default=None)


@given(streams())
def test_smoothed_places_and_scores_are_those_that_were_published(
    channels: list[tuple[Array, list[int]]],
) -> None:
    frames, places = channels[0][0].shape
    smoothed = [
        Windowed(AmsMatcher, scales, places, unit=0.25, lag=20).smooth_all(list(D))
        for D, scales in channels
    ]
    for frame in range(frames):
        candidates = [of_channel[frame].candidate for of_channel in smoothed]
        match = fuse(candidates, MatchingConfig(rule="ams"))
        expected = published_match([(D[frame:], scales) for D, scales in channels])
        if expected is None:
            assert match.place == UNANSWERED
        else:
            assert (-match.score * 16, match.place) == expected


def test_missing_observations_at_the_start_are_no_evidence_of_a_match() -> None:
    windows = Windowed(AmsMatcher, [2, 3], 10)
    for _ in range(5):
        assert windows.update_missing() is NO_CANDIDATE
    D = np.ones((3, 10), np.int32)
    for row in D[:2]:
        assert windows.update(row) is NO_CANDIDATE
    assert windows.update(D[2]).score == 2
