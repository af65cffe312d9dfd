from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.bus.candidate_messages import CandidatesMessage, ChannelCandidate
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage, MatchMessage, SmoothedMessage
from placefield.config import Rule
from placefield.errors import MessageError
from placefield.maps.digest import NO_DIGEST
from placefield.maps.map import Map, fingerprint
from placefield.matching.comparing import distance_matrix
from placefield_tools.dashboard.state import KEPT, LiveState, ShownMap


def header(sequence: int, stream: str = "s", *, live: bool = False, end: bool = False) -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=0, live=live, end=end)


def match(place: int = 3) -> bytes:
    return MatchMessage(
        map=NO_DIGEST, place=place, score=1.5, probability=0.75, known=False
    ).encode()


def candidate(channel: int, place: int, belief: float = 0.5) -> ChannelCandidate:
    return ChannelCandidate(
        channel=channel,
        place=place,
        score=belief,
        places=np.array([place], np.int32),
        evidence=np.array([belief], np.float32),
    )


def candidates(
    *parts: ChannelCandidate, rule: Rule = "filter", shard: int = 0, of: int = 1
) -> bytes:
    return CandidatesMessage(
        map=NO_DIGEST, rule=rule, candidates=parts, shard=shard, shards=of
    ).encode()


@pytest.fixture
def state(route_map: Map) -> LiveState:
    return LiveState(replace(route_map, digest=NO_DIGEST), tolerance=3)


def numbers(state: LiveState) -> list[int]:
    return [answer.header.sequence for answer in state.answers]


def test_an_answer_has_what_came_of_its_frame(state: LiveState, route_map: Map) -> None:
    descriptor = np.zeros(len(route_map.model.components), np.float32)
    descriptor[0] = 1
    feature = FeatureMessage(model=fingerprint(route_map.model), descriptor=descriptor)
    state.add_frame(header(7), b"a frame")
    state.add_feature(header(7), feature.encode())
    state.add_candidates(header(7), candidates(candidate(0, 3), candidate(2, 4)))
    state.add_candidates(header(7), candidates(candidate(1, 5)))
    state.add_match(header(7), match())

    [answer] = state.answers
    assert answer.match.place == 3
    assert answer.rule == "filter"
    assert {number: part.place for number, part in answer.candidates.items()} == {0: 3, 1: 5, 2: 4}
    assert state.frame(answer) == b"a frame"
    [expected] = distance_matrix(route_map.channels[0].metric, [descriptor], 0)
    assert answer.distances is not None
    np.testing.assert_array_equal(answer.distances, expected)  # a column for each place


def test_shards_of_a_channel_are_joined_to_one(state: LiveState) -> None:
    state.add_candidates(header(0), candidates(candidate(0, 3, 0.2), shard=0, of=2))
    state.add_candidates(header(0), candidates(candidate(0, 40, 0.7), shard=1, of=2))
    state.add_match(header(0), match(40))
    joined = state.answers[0].candidates[0]
    assert joined.place == 40
    assert joined.places.tolist() == [3, 40]


def test_a_frame_that_was_answered_before_is_no_new_answer(state: LiveState) -> None:
    for sequence in (0, 1, 1, 0, 2):
        state.add_match(header(sequence), match())
    assert numbers(state) == [0, 1, 2]


def test_answers_missed_in_a_lossless_stream_are_counted(state: LiveState) -> None:
    for sequence in (4, 5, 9):  # what was before the first was before this state
        state.add_match(header(sequence), match())
    assert state.counts["missed"] == 3
    for sequence in (0, 5):
        state.add_match(header(sequence, "live", live=True), match())
    assert state.counts["missed"] == 3


def test_the_end_of_a_stream_is_kept_until_another_is_answered(state: LiveState) -> None:
    state.add_match(header(0), match())
    state.add_match(header(1, end=True), b"")
    assert state.ended == header(1, end=True)
    assert numbers(state) == [0]
    state.add_match(header(0, "t"), match())
    assert state.ended is None


def test_one_looks_back_within_a_stream(state: LiveState) -> None:
    for stream in ("s", "t"):
        for sequence in range(5):
            state.add_match(header(sequence, stream), match(sequence))
    seventh = state.at(7)
    assert seventh is not None
    assert [one.number for one in state.before(seventh, 2)] == [6, 7]
    assert [one.number for one in state.before(seventh, 100)] == [5, 6, 7]
    assert state.at(-1) is None
    assert state.at(10) is None


def test_descriptors_of_another_map_are_counted_and_not_compared(
    state: LiveState, route_map: Map
) -> None:
    size = len(route_map.model.components)
    feature = FeatureMessage(model="another", descriptor=np.zeros(size, np.float32))
    state.add_feature(header(0), feature.encode())
    assert state.counts["foreign"] == 1
    feature = FeatureMessage(
        model=fingerprint(route_map.model), descriptor=np.zeros(size + 1, np.float32)
    )
    with pytest.raises(MessageError):
        state.add_feature(header(0), feature.encode())
    state.add_match(header(0), match())
    assert state.answers[0].distances is None


def test_evidence_that_is_not_of_its_places_is_refused(state: LiveState) -> None:
    bad = ChannelCandidate(
        channel=0,
        place=1,
        score=0.5,
        places=np.array([1, 2], np.int32),
        evidence=np.array([0.5], np.float32),
    )
    with pytest.raises(MessageError, match="channel 0"):
        state.add_candidates(header(0), candidates(bad))


def test_what_is_kept_is_bounded(state: LiveState) -> None:
    large = bytes(2**20)
    for sequence in range(KEPT + 50):
        state.add_frame(header(sequence), large)
        state.add_candidates(header(sequence), candidates(candidate(0, 1)))
        state.add_match(header(sequence), match())
    assert len(state.answers) == KEPT
    kept = [state.frame(answer) is not None for answer in state.answers]
    assert sum(kept) == 64  # MiB
    assert all(kept[-64:])


def test_what_is_never_answered_is_forgotten(state: LiveState) -> None:
    for sequence in range(2000):
        state.add_candidates(header(sequence), candidates(candidate(0, 1)))
    state.add_match(header(0), match())
    assert not state.answers[0].candidates


@given(st.binary(max_size=60))
def test_no_garbage_does_more_than_raise_message_error(route_map: Map, garbage: bytes) -> None:
    state = LiveState(route_map, tolerance=3)
    state.add_frame(header(0), garbage)
    for add in (state.add_feature, state.add_candidates, state.add_match):
        with pytest.raises(MessageError):
            add(header(0), garbage)
    assert not state.answers


def test_a_new_version_of_the_map_is_shown_from_its_first_match_on(
    state: LiveState, route_map: Map
) -> None:
    state.add_match(header(0), match())
    state.add_smoothed(header(0), SmoothedMessage(map=NO_DIGEST, place=3, score=1, lag=1).encode())
    version = ShownMap.of(replace(route_map, digest="f" * 16))
    state.offer(version)
    new = {"map": version.placemap.digest}
    early = CandidatesMessage(**new, rule="filter", candidates=(candidate(0, 7),)).encode()
    state.add_candidates(header(1), early)
    state.add_match(header(1), match())
    assert numbers(state) == [0, 1]
    assert state.placemap.digest == NO_DIGEST
    state.add_match(header(2), MatchMessage(**new, place=7, score=1.0).encode())
    assert numbers(state) == [2]
    assert state.answers[0].number == 2
    assert (state.placemap, state.columns) == version
    assert state.summary is not None
    assert state.summary.frames == 1
    assert not state.counts["foreign"]
    state.add_match(header(3), match())
    assert state.counts["foreign"] == 1


def smoothed(place: int, *, known: bool = True) -> bytes:
    return SmoothedMessage(
        map=NO_DIGEST, place=place, score=5.0, probability=0.999, known=known, lag=9
    ).encode()


@pytest.mark.parametrize("match_first", [True, False])
def test_a_match_and_its_smoothed_one_come_together_in_either_order(
    state: LiveState, match_first: bool
) -> None:
    adders = [lambda: state.add_match(header(0), match(3))]
    adders.insert(match_first, lambda: state.add_smoothed(header(0), smoothed(30)))
    for add in adders:
        add()
    [answer] = state.answers
    assert state.summary is not None
    later = state.smoothed(answer)
    assert later is not None
    assert later.place == 30
    [correction] = state.summary.corrections
    assert (correction.first.place, correction.smoothed.place) == (3, 30)


def test_a_smoothed_match_of_an_earlier_stream_corrects_nothing_of_this_one(
    state: LiveState,
) -> None:
    state.add_match(header(0, "before"), match())
    state.add_match(header(0, "now"), match())
    state.add_smoothed(header(0, "before"), smoothed(30))
    assert state.summary is not None
    assert (state.summary.stream, state.summary.frames, state.summary.corrected) == ("now", 1, 0)


def test_smoothed_matches_are_forgotten_with_their_answers(state: LiveState) -> None:
    for sequence in range(2 * KEPT):
        state.add_match(header(sequence), match())
        state.add_smoothed(header(sequence), smoothed(3))
    assert all(state.smoothed(answer) for answer in state.answers)
    state.add_smoothed(header(0), smoothed(40))  # comes again, long after
    assert state.summary is not None
    assert state.summary.corrected == 2 * KEPT  # all became known, each once


def test_the_last_seconds_are_by_the_clock_of_the_stream(state: LiveState) -> None:
    for sequence in range(5):
        at = Header(stream="s", sequence=sequence, stamp_ns=int(sequence * 10e9))
        state.add_match(at, match())
    last = state.last_seconds(state.answers[-1], 20.0)
    assert [answer.header.sequence for answer in last] == [2, 3, 4]


def test_what_is_of_another_map_is_counted_and_not_shown(state: LiveState) -> None:
    other = {"map": "f" * 16}
    foreign = candidate(0, 7)
    state.add_candidates(
        header(0), CandidatesMessage(**other, rule="filter", candidates=(foreign,)).encode()
    )
    state.add_match(header(0), MatchMessage(**other, place=7, score=1.0).encode())
    state.add_smoothed(header(0), SmoothedMessage(**other, place=7, score=1.0, lag=1).encode())
    assert not state.answers
    assert state.newest_smoothed is None
    assert state.foreign_map == "f" * 16
    assert state.counts["foreign"] == 3
    state.add_match(header(0), match())
    assert state.foreign_map is None
    assert state.answers[-1].candidates == {}
