"""One stream that is smoothed with several lags, beside a stream for each lag."""

from typing import get_args

import numpy as np
import pytest
from filters import channel_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.config import MatchingConfig, Rule
from placefield.maps.map_metrics import identity_metric
from placefield.matching.candidate import Candidate
from placefield.matching.channel_stage import ChannelStage
from placefield.matching.matcher import WHOLE_DRIVE

Descriptors = list[NDArray[np.float32] | None]
Bits = tuple[int, float, bytes, bytes, float]

lags_of_stream = st.lists(
    st.sampled_from([0, 1, 2, 5, 20, WHOLE_DRIVE]), min_size=1, max_size=4, unique=True
)


@st.composite
def drives(draw: st.DrawFn) -> tuple[NDArray[np.float32], Descriptors]:
    """The places of a map, and frames of it: some are repeated, some are missing."""
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    places = np.cumsum(rng.standard_normal((draw(st.integers(1, 40)), 8)), axis=0)
    at = np.sort(rng.integers(0, len(places), draw(st.integers(1, 50))))
    seen = places[at] + draw(st.sampled_from([0, 0.3, 3])) * rng.standard_normal((len(at), 8))
    missing = rng.random(len(at)) < draw(st.sampled_from([0, 0.3, 1]))
    frames = [None if gone else of_length_1(row) for row, gone in zip(seen, missing, strict=True)]
    return of_length_1(places), frames


def of_length_1(vectors: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.float32(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def bits(candidate: Candidate) -> Bits:
    arrays = candidate.places.tobytes(), candidate.evidence.tobytes()
    return candidate.place, candidate.score, *arrays, candidate.too_fast


def matched(
    stage: ChannelStage, frames: Descriptors, lags: list[int]
) -> tuple[list[list[Bits]], list[list[tuple[int, int, int, Bits]]]]:
    """The candidates of each frame, and those smoothed with each lag: channel, number and lag."""
    stream, causal = stage.new_stream(lags=lags), []
    for frame in frames:
        compared = None if frame is None else next(stage.compare([frame]))
        causal.append([bits(each) for each in stream.update(compared)])
    for _ in range(stream.end()):
        stream.update(None)
    stream.finish()
    smoothed = [
        [
            (channel, number, each.lag, bits(each.candidate))
            for channel, of_channel in stream.smoothed(which).items()
            for number, each in of_channel
        ]
        for which in range(len(lags))
    ]
    return causal, smoothed


@pytest.mark.parametrize("rule", get_args(Rule))
@given(drives(), lags_of_stream, st.booleans())
@settings(max_examples=25)
def test_a_stream_answers_with_several_lags_as_with_each_alone(
    rule: Rule,
    drive: tuple[NDArray[np.float32], Descriptors],
    lags: list[int],
    reverse: bool,
) -> None:
    places, frames = drive
    channels = [channel_of(identity_metric(places), scales) for scales in ([2, 3, 9], [4, 12])]
    matching = MatchingConfig(rule=rule, reverse=reverse)
    stage = ChannelStage(dict(enumerate(channels)), matching)
    causal, smoothed = matched(stage, frames, lags)
    for lag, of_lag in zip(lags, smoothed, strict=True):
        alone, (smoothed_alone,) = matched(stage, frames, [lag])
        assert causal == alone
        assert of_lag == smoothed_alone
        assert len(of_lag) == 2 * len(frames)
