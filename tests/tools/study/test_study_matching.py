from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.config import MatchingConfig, Rule
from placefield.maps.map import MapChannel, MapMetric
from placefield.maps.map_metrics import learned_metric
from placefield.matching.candidate import Candidate
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.sharding import ChannelShard
from placefield_tools.study.matching import smoothed_candidates
from placefield_tools.study.trial import Trial


@pytest.fixture(scope="module")
def channels(trial: Trial) -> list[MapChannel]:
    """Three channels; the first and the last share a metric."""
    first, other = trial.placemap.channels
    reference = trial.placemap.model.of_reference(trial.traverse.raw)
    projection = np.random.default_rng(1).standard_normal((12, reference.shape[1]))
    metric = learned_metric(projection.astype(np.float32), reference)
    return [first, replace(other, metric=metric), other]


@pytest.mark.parametrize("rule", get_args(Rule))
def test_a_channel_among_others_smooth_on_the_candidates_of_its_own_comparisons(
    trial: Trial, channels: list[MapChannel], rule: Rule
) -> None:
    descriptors = [None if frame in (0, 30) else d for frame, d in enumerate(trial.descriptors)]
    together = smoothed_candidates(channels, descriptors, trial.metres, trial.matching(rule))
    for channel, candidates in zip(channels, together, strict=True):
        expected = smoothed_alone(channel, descriptors, trial.matching(rule))
        assert len(candidates) == len(descriptors)
        for candidate, other in zip(candidates, expected, strict=False):
            assert (candidate.place, candidate.score) == (other.place, other.score)
            np.testing.assert_array_equal(candidate.places, other.places)
            np.testing.assert_array_equal(candidate.evidence, other.evidence)


def smoothed_alone(
    channel: MapChannel, descriptors: list[NDArray[np.float32] | None], matching: MatchingConfig
) -> list[Candidate]:
    """What a channel by itself has smoothed, tail included."""
    matcher = ChannelShard(channel, matching).new_matcher()
    places = MetricPlaces(channel.metric, exact=True)
    smoothed = []
    for descriptor in [*descriptors, *[None] * matcher.tail]:
        matcher.update(None if descriptor is None else next(places.compare(descriptor[None])))
        smoothed += matcher.smoothed()
    return [each.candidate for each in smoothed + matcher.finish()]


def test_a_frame_is_compared_once_for_all_channels_that_share_a_metric(
    trial: Trial, channels: list[MapChannel], monkeypatch: pytest.MonkeyPatch
) -> None:
    compared: Counter[MapMetric] = Counter()
    compare = MetricPlaces.compare

    def counting(self: MetricPlaces, descriptors: NDArray[np.float32]) -> Iterator[Comparison]:
        for comparison in compare(self, descriptors):
            compared[comparison.metric] += 1
            yield comparison

    monkeypatch.setattr(MetricPlaces, "compare", counting)
    smoothed_candidates(channels, trial.descriptors, trial.metres, trial.matching("filter"))
    frames = len(trial.descriptors)
    assert compared == {channels[0].metric: frames, channels[1].metric: frames}
