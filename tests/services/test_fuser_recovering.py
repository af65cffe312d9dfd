import numpy as np
import pytest
from bus_doubles import header
from fuser_stage import DEADLINE_S, KEYS, Clock, Stage

from placefield.bus.candidate_messages import CandidatesMessage, ChannelCandidate
from placefield.bus.message import Header
from placefield.bus.messages import CacheQuery, FeatureMessage
from placefield.fusion.fusion_stage import FusionStage
from placefield.maps.map import Map
from placefield.matching.candidate import NO_PLACES, Candidate
from placefield_services import fuser_run as fuser_module


@pytest.fixture
def stage(route_map: Map, monkeypatch: pytest.MonkeyPatch) -> Stage:
    clock = Clock()
    monkeypatch.setattr(fuser_module, "time", clock)
    return Stage(route_map, clock)


def test_a_frame_whose_answer_was_lost_is_answered_again(stage: Stage) -> None:
    for sequence in range(3):
        stage.announce(header(sequence))
        stage.answer((0, 1, 2), header(sequence))
    stage.announce(header(1, oldest=1))
    assert [sequence for sequence, _ in stage.published] == [0, 1, 2, 1]
    assert stage.published[3] == stage.published[1]
    assert stage.acks.sequences == [0, 1, 2, 1]


def test_a_restarted_fuser_begins_with_the_oldest_awaited_frame(stage: Stage) -> None:
    stage.announce(header(7, oldest=5))
    stage.answer((0, 1, 2), header(7, oldest=5))
    stage.pass_time(1000)
    assert stage.published == []
    for sequence in (5, 6):
        stage.announce(header(sequence, oldest=5))
        stage.answer((0, 1, 2), header(sequence, oldest=5))
    assert [sequence for sequence, _ in stage.published] == [5, 6, 7]


def test_where_the_featurizer_forgot_the_stream_every_later_match_of_it_says_so(
    stage: Stage,
) -> None:
    forgotten = FeatureMessage(model="m", descriptor=None, forgotten=True)
    for sequence in range(6):
        about = header(sequence)
        stage.handle(KEYS.feature, about, forgotten) if sequence == 2 else stage.announce(about)
        stage.answer((0, 1, 2), about)
    stage.announce(header(0, stream="next"))
    stage.answer((0, 1, 2), header(0, stream="next"))
    flags = [message.forgotten for _, message in stage.matches.sent if message]
    assert flags == [False, False, True, True, True, True, False]


def test_where_a_worker_lacks_frames_of_the_stream_later_matches_say_so(stage: Stage) -> None:
    for sequence in range(4):
        stage.announce(header(sequence))
        candidates = [stage.written(channel, sequence) for channel in range(3)]
        message = stage.message(*candidates).model_copy(update={"forgotten": sequence == 1})
        stage.handle(KEYS.candidates("worker"), header(sequence), message)
    flags = [message.forgotten for _, message in stage.matches.sent if message]
    assert flags == [False, True, True, True]


def test_descriptors_are_cached_for_queries(stage: Stage) -> None:
    for sequence in range(3):
        stage.announce(header(sequence))
    query = CacheQuery(stream="s", first=1, end=9).encode()
    kept = [Header.decode(attachment).sequence for _, attachment in stage.features.reply(query)]
    assert kept == [1, 2]


def test_a_restarted_fuser_fills_its_cache_from_others(stage: Stage) -> None:
    message = FeatureMessage(model="m", descriptor=None).encode()
    stage.elsewhere.kept = {sequence: (header(sequence), message) for sequence in range(5)}
    stage.announce(header(5, oldest=5))
    query = CacheQuery(stream="s", first=0, end=9).encode()
    kept = [Header.decode(attachment).sequence for _, attachment in stage.features.reply(query)]
    assert kept == [0, 1, 2, 3, 4, 5]


def test_a_stream_does_not_end_before_its_last_frames_have_come(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer((0, 1, 2), header(0))
    stage.handle(KEYS.feature, header(2, end=True))
    stage.pass_time(1000)
    assert [about.sequence for about, _ in stage.matches.sent] == [0]
    stage.announce(header(1))
    stage.answer((0, 1, 2), header(1))
    assert [about.sequence for about, _ in stage.matches.sent] == [0, 1, 2]
    stage.pass_time(DEADLINE_S)
    assert stage.acks.sequences[-1] == 2


def test_frames_that_their_source_has_answers_of_are_not_waited_for(stage: Stage) -> None:
    stage.announce(header(5, oldest=3))
    stage.announce(header(9, oldest=8))  # others have answered while this fuser was started
    stage.announce(header(8, oldest=8))
    for sequence in (8, 9):
        stage.answer((0, 1, 2), header(sequence, oldest=8))
    assert [sequence for sequence, _ in stage.published] == [8, 9]


def test_a_defect_in_one_frame_is_answered_by_nothing_and_costs_no_other(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(FusionStage, "fuse", lambda *_, **__: 1 // 0)
        stage.announce(header(0))
        stage.answer((0, 1, 2), header(0))
    stage.announce(header(1))
    stage.answer((0, 1, 2), header(1))
    assert [match.place for _, match in stage.published] == [-1, stage.expected(1).place]
    assert stage.published[0][1].missing == (0, 1, 2)
    assert stage.counts["failed"] == 1


def test_candidates_that_come_before_their_descriptor_and_do_not_fit_do_not_affect_it(
    route_map: Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(fuser_module, "time", clock)
    stage = Stage(route_map, clock, "evidence")
    short = Candidate(1, 0.0, NO_PLACES, np.zeros(3, np.float32))
    for shard in range(2):
        written = (ChannelCandidate.of(0, short),)
        message = CandidatesMessage(
            map=stage.map, rule="evidence", shard=shard, shards=2, candidates=written
        )
        stage.handle(KEYS.candidates(f"worker{shard}"), header(0), message)
    stage.announce(header(0))
    stage.pass_time(DEADLINE_S)
    assert [sequence for sequence, _ in stage.published] == [0]
    assert stage.counts["malformed"] == 1
