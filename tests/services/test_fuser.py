from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bus_doubles import header
from fuser_stage import CANDIDATES, CHANNELS, DEADLINE_S, KEYS, Clock, Stage

from placefield.bus.candidate_messages import CandidatesMessage, ChannelCandidate
from placefield.bus.message import Message
from placefield.bus.messages import FeatureMessage, MatchMessage
from placefield.config import Rule
from placefield.errors import MessageError
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield.matching.candidate import NO_EVIDENCE, NO_PLACES, Candidate
from placefield_services import fuser_run as fuser_module
from placefield_services import held_candidates

Held = Callable[[int], tuple[np.ndarray, np.ndarray]]
"""Makes the places and evidence of a candidate, for a map of so many places."""


@pytest.fixture
def stage(route_map: Map, monkeypatch: pytest.MonkeyPatch) -> Stage:
    clock = Clock()
    monkeypatch.setattr(fuser_module, "time", clock)
    return Stage(route_map, clock)


def test_a_frame_is_answered_once_all_channels_have_in_whatever_order(stage: Stage) -> None:
    stage.answer(2, header(0))
    stage.announce(header(0))
    stage.answer(0, header(0))
    assert not stage.published
    stage.answer(1, header(0))
    assert stage.published == [(0, stage.expected(0))]
    assert stage.acks.sent == [(header(0), None)]


def test_a_frame_that_was_answered_before_its_descriptor_came_is_answered_once(
    stage: Stage,
) -> None:
    stage.announce(header(0))
    stage.answer((0, 1, 2), header(0))
    stage.answer((0, 1, 2), header(1))
    stage.announce(header(1))
    assert [sequence for sequence, _ in stage.published] == [0, 1]
    stage.announce(header(1))  # again, so its source has not received the answer
    assert [sequence for sequence, _ in stage.published] == [0, 1, 1]


def test_matches_leave_in_the_order_of_the_frames(stage: Stage) -> None:
    for sequence in (0, 1):
        stage.announce(header(sequence))
    for channel in range(CHANNELS):
        stage.answer(channel, header(1))
    assert not stage.published
    for channel in range(CHANNELS):
        stage.answer(channel, header(0))
    assert stage.published == [(0, stage.expected(0)), (1, stage.expected(1))]
    assert stage.acks.sequences == [1]  # stands for both


def test_at_the_deadline_a_frame_is_answered_with_what_arrived(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer(0, header(0))
    stage.answer(2, header(0))
    stage.pass_time(0.9 * DEADLINE_S)
    assert not stage.published
    stage.pass_time(0.2 * DEADLINE_S)
    assert stage.published == [(0, stage.expected(0, 1))]
    stage.answer(1, header(0))
    assert stage.counts["late"] == 1
    assert len(stage.published) == 1


def test_a_channel_without_a_living_worker_is_not_awaited(stage: Stage) -> None:
    stage.set_alive(1, False)
    stage.announce(header(0))
    stage.answer(0, header(0))
    stage.answer(2, header(0))
    assert stage.published == [(0, stage.expected(0, 1))]
    stage.set_alive(1, True)
    stage.announce(header(1))
    for channel in range(CHANNELS):
        stage.answer(channel, header(1))
    assert stage.published[1:] == [(1, stage.expected(1))]


def test_a_frame_that_no_channel_answers_is_answered_all_the_same(stage: Stage) -> None:
    for channel in range(CHANNELS):
        stage.set_alive(channel, False)
    stage.announce(header(0))
    assert stage.published == [(0, Match(-1, 0.0, (0, 1, 2)))]
    assert stage.counts["partial"] == 1


def test_frames_that_are_too_fast_are_reported_and_counted(stage: Stage) -> None:
    for sequence, posterior in enumerate([0.0, 0.75, 0.25, 1.0]):
        written = [stage.written(channel, sequence, too_fast=posterior) for channel in range(3)]
        stage.announce(header(sequence))
        stage.handle(CANDIDATES, header(sequence), stage.message(*written))
    assert [match.too_fast for _, match in stage.published] == [False, True, False, True]
    assert (stage.counts["too_fast"], stage.counts["matches"]) == (2, 4)


def test_the_stream_ends_behind_its_last_answer(stage: Stage) -> None:
    stage.announce(header(0))
    stage.handle(KEYS.feature, header(1, end=True))
    assert not stage.matches.sent
    for channel in range(CHANNELS):
        stage.smooth(header(1, end=True), stage.smoothed(channel, 0, lag=0))
        stage.answer(channel, header(0))
    assert stage.matches.sequences == [0, 1]
    assert stage.matches.sent[-1] == stage.acks.sent[-1] == (header(1, end=True), None)


def test_a_stream_without_a_frame_ends_too(stage: Stage) -> None:
    stage.handle(KEYS.feature, header(0, end=True))
    assert stage.acks.sent == [(header(0, end=True), None)]


def test_second_answers_of_replicas_are_dropped_and_counted(stage: Stage) -> None:
    stage.announce(header(0))
    for channel in (0, 0, 1, 2):
        stage.answer(channel, header(0))
    assert stage.published == [(0, stage.expected(0))]
    assert stage.counts["duplicate"] == 1


def test_one_message_answers_for_all_channels_of_a_worker(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer((2, 0), header(0))
    assert not stage.published
    stage.answer(1, header(0))
    assert stage.published == [(0, stage.expected(0))]


def test_of_replicas_the_first_answer_counts_channel_by_channel(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer((0, 1), header(0))
    twice = stage.written(1, 0, **vars(stage.candidate(1, 99)))
    stage.handle(CANDIDATES, header(0), stage.message(twice, stage.written(2, 0)))
    assert stage.published == [(0, stage.expected(0))]
    assert stage.counts["duplicate"] == 1


def test_a_new_stream_begins_afresh_once_the_old_one_has_its_answers(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer(0, header(0))
    for channel in range(CHANNELS):  # those that are faster than the descriptor wait for it
        stage.answer(channel, header(0, stream="next"))
    assert not stage.matches.sent
    stage.announce(header(0, stream="next"))
    stage.answer(1, header(0))
    assert [about.stream for about, _ in stage.matches.sent] == ["s", "next"]
    assert stage.counts["partial"] == 1
    assert stage.counts["stale"] == 1


def test_in_a_live_stream_a_frame_is_not_held_back_for_those_that_were_dropped(
    stage: Stage,
) -> None:
    for sequence in (0, 5, 6):
        stage.announce(header(sequence, live=True))
        for channel in range(CHANNELS):
            stage.answer(channel, header(sequence, live=True))
    assert [sequence for sequence, _ in stage.published] == [0, 5, 6]


def test_a_live_frame_has_its_credit_only_once_a_living_channel_has_answered_it(
    stage: Stage,
) -> None:
    stage.announce(header(0, live=True))
    stage.pass_time(1.1 * DEADLINE_S)
    assert stage.published == [(0, stage.expected(0, 0, 1, 2))]
    assert not stage.acks.sent
    stage.answer(0, header(0, live=True))  # late
    assert stage.acks.sequences == [0]
    for channel in range(CHANNELS):
        stage.set_alive(channel, False)
    stage.announce(header(1, live=True))
    stage.pass_time(0.1)
    assert stage.acks.sequences == [0, 1]  # nobody is there who could fall behind


def test_an_answer_has_the_pose_of_its_place_where_the_map_has_poses(
    route_map: Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(fuser_module, "time", clock)
    poses = np.random.default_rng(2).normal(size=(route_map.places.count, 3))
    posed = replace(route_map, places=replace(route_map.places, poses=poses))
    stage = Stage(posed, clock)
    stage.announce(header(0))
    for channel in range(CHANNELS):
        stage.answer(channel, header(0))
    ((_, match),) = stage.matches.sent
    assert isinstance(match, MatchMessage)
    assert match.pose == tuple(poses[match.place])


def garbage(stage: Stage) -> list[tuple[str, Message | bytes, str]]:
    """Key, message, and why it is refused."""
    count, good = stage.places, stage.candidate(0, 0)
    feature = FeatureMessage(model="m", descriptor=None)

    def beside_a_good_one(**changes: Any) -> CandidatesMessage:
        return stage.message(stage.written(1, 0), stage.written(0, 0, **changes))

    return [
        (KEYS.feature, b"\xc1", "no msgpack"),
        (KEYS.feature, b"", "no msgpack"),
        (KEYS.feature, beside_a_good_one(), "FeatureMessage"),
        (CANDIDATES, b"", "no msgpack"),
        (CANDIDATES, feature, "CandidatesMessage"),
        (CANDIDATES, stage.message(stage.written(0, 0), rule="ams"), "--rule"),
        (CANDIDATES, beside_a_good_one(place=count), "another map"),
        (CANDIDATES, beside_a_good_one(evidence=good.evidence[1:]), "another map"),
        (CANDIDATES, beside_a_good_one(evidence=NO_EVIDENCE), "another map"),
        (CANDIDATES, beside_a_good_one(places=NO_PLACES), "another map"),
        (CANDIDATES, beside_a_good_one(places=NO_PLACES, evidence=NO_EVIDENCE), "another map"),
        (CANDIDATES, beside_a_good_one(place=-1), "another map"),
    ] + [
        (
            CANDIDATES,
            beside_a_good_one(places=np.array(places, np.int32), evidence=good.evidence[:3]),
            "another map",
        )
        for places in ([0, 2, 1], [3, 3, 4], [-1, 0, 1], [0, 1, count], [-(2**31), 0, 2**31 - 1])
    ]


def test_garbage_under_a_good_header_leaves_the_stream_as_it_was(stage: Stage) -> None:
    for sequence in range(3):
        stage.announce(header(sequence))
        for key, message, reason in garbage(stage):
            for about in (header(sequence), header(0, stream="another"), header(2**40)):
                with pytest.raises(MessageError, match=reason):
                    stage.handle(key, about, message)
        stage.pass_time(DEADLINE_S / 2)
        for channel in range(CHANNELS):
            stage.answer(channel, header(sequence))
    assert stage.published == [(s, stage.expected(s)) for s in range(3)]
    assert stage.counts == {"streams": 1, "partial": 0, "matches": 3}


def test_a_candidate_of_a_channel_that_the_map_has_not_is_counted(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer(9, header(0))
    for channel in range(CHANNELS):
        stage.answer(channel, header(0))
    assert stage.published == [(0, stage.expected(0))]
    assert stage.counts["unknown_channel"] == 1


def test_of_a_stream_that_does_not_begin_the_newest_candidates_are_kept_and_the_others_counted(
    stage: Stage,
) -> None:
    for sequence in range(300):
        stage.answer(0, header(sequence, stream="late"))
    assert stage.counts["dropped_full"] == 300 - 256
    stage.answer((1, 2), header(299, stream="late"))
    stage.announce(header(299, stream="late", oldest=299))
    assert stage.published == [(299, stage.expected(299))]


def test_nor_do_they_take_more_than_so_many_bytes(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(held_candidates, "_MOST_BYTES", 1000)
    for sequence in range(100):
        stage.answer(0, header(sequence, stream="late"))
    assert stage.counts["dropped_full"] > 90


def test_a_shard_that_reports_of_more_places_than_there_are_is_of_another_map(stage: Stage) -> None:
    places = np.arange(stage.places + 1, dtype=np.int32)
    evidence = np.ones(len(places), np.float32)
    written = stage.written(0, 0, places=places, evidence=evidence)
    message = stage.message(written).model_copy(update={"shard": 0, "shards": 2})
    with pytest.raises(MessageError, match="another map"):
        stage.handle(CANDIDATES, header(0), message)


def belief(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(2, 5, dtype=np.int32), np.full(3, 0.3, np.float32)


def value_of_every_place(count: int) -> tuple[np.ndarray, np.ndarray]:
    return NO_PLACES, np.linspace(-1, 1, count, dtype=np.float32)


def nothing(count: int) -> tuple[np.ndarray, np.ndarray]:
    return NO_PLACES, NO_EVIDENCE


@pytest.mark.parametrize(
    ("rule", "right", "wrong"),
    [
        ("filter", [belief], [value_of_every_place, nothing]),
        ("evidence", [value_of_every_place], [belief, nothing]),
        ("ams", [nothing], [belief, value_of_every_place]),
    ],
)
def test_candidates_hold_what_their_rule_has_and_nothing_else(
    route_map: Map, rule: Rule, right: list[Held], wrong: list[Held]
) -> None:
    stage = Stage(route_map, Clock(), rule)
    for held in wrong:
        places, evidence = held(stage.places)
        message = stage.message(stage.written(0, 0, places=places, evidence=evidence))
        with pytest.raises(MessageError, match="another map"):
            stage.handle(CANDIDATES, header(0), message)
    for sequence, held in enumerate(right):
        stage.announce(header(sequence))
        places, evidence = held(stage.places)
        for channel in range(CHANNELS):
            message = stage.message(stage.written(channel, 0, places=places, evidence=evidence))
            stage.handle(CANDIDATES, header(sequence), message)
    assert [sequence for sequence, _ in stage.published] == list(range(len(right)))


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_the_shards_of_a_channel_answer_as_the_channel_does(
    stage: Stage, order: tuple[int, ...]
) -> None:
    whole = stage.candidate(1, 0)
    cuts = np.array_split(np.arange(len(whole.places)), 3)
    stage.answer((0, 2), header(0))
    stage.announce(header(0))
    for shard in order:
        assert not stage.published
        places, evidence = whole.places[cuts[shard]], whole.evidence[cuts[shard]]
        best = int(np.argmax(evidence))
        part = Candidate(int(places[best]), float(evidence[best]), places, evidence)
        written = ChannelCandidate.of(1, part)
        message = CandidatesMessage(
            map=stage.map, rule="filter", shard=shard, shards=3, candidates=(written,)
        )
        stage.handle(KEYS.candidates(f"worker{shard}"), header(0), message)
    ((sequence, match),) = stage.published
    expected = stage.expected(0)
    assert (sequence, match.place, match.missing) == (0, expected.place, ())
    assert match.score == pytest.approx(expected.score, abs=1e-3)  # the next to nothing is dropped
