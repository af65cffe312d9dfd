import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.config import Rule
from placefield.maps.map import Map
from placefield.matching.candidate import Candidate
from placefield.matching.channel_matcher import ChannelMatcher, matcher_of
from placefield.matching.distances import PlaceDistances

Array = NDArray[np.float32]
RULES: list[Rule] = ["evidence", "lowest-score"]


def random_walk(frames: int, seed: int) -> Array:
    steps = np.random.default_rng(seed).normal(size=(frames, 5))
    return np.cumsum(steps, axis=0).astype(np.float32)


def matcher(places: int, scales: list[int], rule: Rule) -> ChannelMatcher:
    projection = np.random.default_rng(9).normal(size=(5, 5)).astype(np.float32)
    return ChannelMatcher(PlaceDistances(projection, random_walk(places, 1)), scales, rule)


def bits(candidate: Candidate) -> tuple[int, float, bytes]:
    return candidate.place, candidate.score, candidate.evidence.tobytes()


@pytest.mark.parametrize("rule", RULES)
@given(
    places=st.integers(3, 40),
    scales=st.lists(st.integers(2, 12), min_size=1, max_size=3, unique=True).map(sorted),
    seen=st.lists(st.booleans(), min_size=1, max_size=40),
    seed=st.integers(0, 99),
)
@settings(max_examples=60)
def test_what_came_before_the_longest_window_changes_not_one_bit(
    rule: Rule, places: int, scales: list[int], seen: list[bool], seed: int
) -> None:
    """Where the window begins with frames unseen, the last frame seen before them is part of it."""
    query = [
        row if there else None
        for row, there in zip(random_walk(len(seen), seed), seen, strict=True)
    ]
    old = matcher(places, scales, rule)
    candidates = [old.push(descriptor) for descriptor in query]
    begin = max(len(query) - old.longest_scale, 0)
    while begin > 0 and query[begin] is None:
        begin -= 1
    new = matcher(places, scales, rule)
    for descriptor in query[begin:]:
        candidate = new.push(descriptor)
    assert bits(candidate) == bits(candidates[-1])


@pytest.mark.parametrize("rule", RULES)
def test_frames_unseen_leave_the_others_on_their_diagonal(rule: Rule) -> None:
    places = random_walk(60, 1)
    channel = ChannelMatcher(PlaceDistances(np.eye(5, dtype=np.float32), places), [4, 8, 12], rule)
    for frame in range(60):
        candidate = channel.push(None if frame in (20, 21, 40) else places[frame])
        if frame >= 12:
            assert candidate.place == frame


@pytest.mark.parametrize("rule", RULES)
def test_a_maps_channel_is_matched_under_its_metric_at_its_scales(
    small_map: Map, rule: Rule
) -> None:
    channel = small_map.channels[1]
    made = matcher_of(channel, rule)
    by_hand = ChannelMatcher(
        PlaceDistances(channel.projection, channel.places), [int(s) for s in channel.scales], rule
    )
    assert made.longest_scale == channel.scales.max()
    for descriptor in channel.places:
        assert bits(made.push(descriptor)) == bits(by_hand.push(descriptor))
