"""Channels in one stage against each of them alone."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from comparisons import compared
from numpy.typing import NDArray

from placefield.config import MatchingConfig, Rule
from placefield.errors import ConfigError
from placefield.maps.map import Map
from placefield.matching.candidate import Candidate
from placefield.matching.channel_stage import ChannelStage, StreamMatcher
from placefield.matching.comparing import Comparison
from placefield.matching.filter_matcher import FilterMatcher
from placefield.matching.matcher import Partial
from placefield.matching.sharding import ChannelShard

RULES: tuple[Rule, ...] = get_args(Rule)
Array = NDArray[np.float32]


@pytest.fixture
def query(small_map: Map) -> list[Array]:
    metric = small_map.channels[0].metric
    return [*(metric.unit * metric.places).astype(np.float32)]


def bits(candidate: Candidate) -> tuple[int, float, bytes, bytes]:
    return (
        candidate.place,
        candidate.score,
        candidate.places.tobytes(),
        candidate.evidence.tobytes(),
    )


def alone(
    placemap: Map, number: int, rule: Rule, query: Sequence[Array | None]
) -> list[tuple[int, float, bytes, bytes]]:
    """What a channel's matcher answers to each frame."""
    channel = placemap.channels[number]
    matcher = ChannelShard(channel, MatchingConfig(rule=rule)).new_matcher()
    return [bits(matcher.update(frame)) for frame in compared(channel.metric, query)]


def finish(stream: StreamMatcher, partials: Mapping[int, Partial]) -> dict[int, Candidate]:
    """Do the reduce step of whole channels."""
    return stream.reduce({number: [partial] for number, partial in partials.items()})


@pytest.mark.parametrize("rule", RULES)
def test_a_stream_matches_each_frame_in_every_channel_as_in_that_alone(
    small_map: Map, query: list[Array], rule: Rule
) -> None:
    stage = ChannelStage(dict(enumerate(small_map.channels)), MatchingConfig(rule=rule))
    stream, together = stage.new_stream(), stage.compare(query)
    observed = [None if frame in (0, 20, 21) else one for frame, one in enumerate(query)]
    answers = []
    for descriptor in observed:
        frame = next(together)
        answers.append(stream.update(None if descriptor is None else frame))
    for number in range(len(small_map.channels)):
        expected = alone(small_map, number, rule, observed)
        assert [bits(candidates[number]) for candidates in answers] == expected
    assert stream.next == len(query)


@pytest.mark.parametrize("rule", RULES)
def test_frames_that_were_missed_take_their_steps_as_missing_observations(
    small_map: Map, query: list[Array], rule: Rule
) -> None:
    stage = ChannelStage({5: small_map.channels[1]}, MatchingConfig(rule=rule))
    stream, missed = stage.new_stream(), {3, 4, 5, 12}
    answers = []
    for sequence, frame in enumerate(stage.compare(query[:20])):
        if sequence in missed:
            continue
        while stream.next <= sequence:
            candidates = finish(stream, stream.local(frame, sequence))
        answers.append(bits(candidates[5]))
    observed = [None if s in missed else one for s, one in enumerate(query[:20])]
    expected = alone(small_map, 1, rule, observed)
    assert answers == [one for s, one in enumerate(expected) if s not in missed]


@pytest.mark.parametrize("rule", RULES)
def test_of_a_gap_of_any_length_only_as_many_frames_are_processed_as_make_a_difference(
    small_map: Map, query: list[Array], rule: Rule
) -> None:
    channel = small_map.channels[0]
    matching = MatchingConfig(rule=rule)
    memory = ChannelShard(channel, matching).new_matcher().horizon
    stage = ChannelStage({0: channel}, matching)
    stream, (first, last) = stage.new_stream(), stage.compare(query[:2])
    stream.update(first)
    steps = 0
    while stream.next <= 2**40:
        candidates = finish(stream, stream.local(last, 2**40))
        steps += 1
    assert steps == memory + 1
    expected = alone(small_map, 0, rule, [query[0], *[None] * memory, query[1]])
    assert bits(candidates[0]) == expected[-1]


def test_a_frame_on_which_a_channel_fails_is_missing_in_that_alone(
    small_map: Map, query: list[Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    channels = [replace(one, metric=replace(one.metric)) for one in small_map.channels]
    stage = ChannelStage(dict(enumerate(channels)), MatchingConfig())
    stream, frames = stage.new_stream(), list(stage.compare(query[:8]))
    failing, real = iter(range(100)), FilterMatcher.local

    def local(self: FilterMatcher, frame: Comparison | None, metres: float | None) -> Partial:
        if next(failing) == 5:  # of two channels, the second, at the third frame
            raise ZeroDivisionError
        return real(self, frame, metres)

    monkeypatch.setattr(FilterMatcher, "local", local)
    answers = {}
    for sequence, frame in enumerate(frames):
        try:
            while stream.next <= sequence:
                candidates = finish(stream, stream.local(frame, sequence))
                answers[stream.next - 1] = candidates
        except ZeroDivisionError:
            assert sequence == 2
    whole = alone(small_map, 0, "filter", query[:8])
    damaged = alone(
        small_map, 1, "filter", [None if s == 2 else q for s, q in enumerate(query[:8])]
    )
    assert [bits(answers[sequence][0]) for sequence in range(8)] == whole
    assert [bits(answers[sequence][1]) for sequence in range(8)] == damaged


def test_channels_that_answer_alike_are_answered_for_once(
    small_map: Map, query: list[Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    channel = small_map.channels[0]
    stage = ChannelStage({0: channel, 3: channel, 5: channel}, MatchingConfig())
    steps, real = iter(range(100)), FilterMatcher.local

    def local(self: FilterMatcher, frame: Comparison | None, metres: float | None) -> Partial:
        next(steps)
        return real(self, frame, metres)

    monkeypatch.setattr(FilterMatcher, "local", local)
    stream = stage.new_stream()
    expected = alone(small_map, 0, "filter", query[:8])
    for frame, answer in zip(stage.compare(query[:8]), expected, strict=True):
        candidates = stream.update(frame)
        assert [bits(candidate) for candidate in candidates] == [answer] * 3
    assert next(steps) == 8 + 8  # of the whole channel that was matched alone, too


def test_shards_are_no_smaller_than_they_may_be(small_map: Map) -> None:
    with pytest.raises(ConfigError, match="each needs 12; take 7"):
        ChannelStage(dict(enumerate(small_map.channels)), MatchingConfig(), 0, 80)


def test_of_no_descriptors_there_is_nothing_to_compare(small_map: Map) -> None:
    stage = ChannelStage({0: small_map.channels[0]}, MatchingConfig())
    assert list(stage.compare([])) == []
