"""The smoothed matches of a fuser: of each answered frame one, in order, whatever happens."""

import numpy as np
import pytest
from bus_doubles import header
from fuser_stage import CHANNELS, DEADLINE_S, KEYS, LAG, Clock, Stage

from placefield.bus.candidate_messages import CandidatesMessage, SmoothedFrames
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.errors import MessageError
from placefield.maps.map import Map
from placefield.matching.candidate import Candidate
from placefield_services import fuser_run as fuser_module

ALL = range(CHANNELS)


@pytest.fixture
def stage(route_map: Map, monkeypatch: pytest.MonkeyPatch) -> Stage:
    clock = Clock()
    monkeypatch.setattr(fuser_module, "time", clock)
    return Stage(route_map, clock)


def smooth_in_all(stage: Stage, about: Header, sequence: int, lag: int) -> None:
    stage.smooth(about, *(stage.smoothed(channel, sequence, lag) for channel in ALL))


def finish(stage: Stage, frames: int, *sequences: int) -> None:
    """Let the stream end, and the worker of all channels smooth these frames."""
    stage.handle(KEYS.feature, header(frames, end=True))
    end = header(frames, end=True)
    stage.smooth(end, *(stage.smoothed(c, s, frames - 1 - s) for s in sequences for c in ALL))


def test_each_frame_has_one_smoothed_match_in_order_and_the_rest_come_with_the_end(
    stage: Stage,
) -> None:
    for sequence in range(4):
        stage.announce(header(sequence))
        if sequence < 2:
            stage.answer((0, 1, 2), header(sequence))
        else:
            smooth_in_all(stage, header(sequence), sequence - 2, lag=2)
    assert stage.published_smoothed == [(s, stage.smoothed_as(s), 2) for s in (0, 1)]
    finish(stage, 4, 2, 3)
    expected = [(s, stage.smoothed_as(s), lag) for s, lag in ((0, 2), (1, 2), (2, 1), (3, 0))]
    assert stage.published_smoothed == expected
    assert stage.smoothed_matches.sent[-1] == stage.acks.sent[-1] == (header(4, end=True), None)
    assert stage.counts["smoothed"] == 4
    assert [about for about, _ in stage.smoothed_matches.sent[:-1]] == [header(s) for s in range(4)]


def test_what_is_smoothed_at_once_comes_with_the_frame_itself(stage: Stage) -> None:
    stage.announce(header(0))
    for channel in ALL:
        stage.smooth(header(0), stage.smoothed(channel, 0, lag=0))
    assert stage.published_smoothed == [(0, stage.smoothed_as(0), 0)]
    assert stage.matches.sequences == [0]


def test_a_channel_that_has_not_smoothed_a_frame_in_time_is_named(stage: Stage) -> None:
    stage.set_alive(1, False)
    for sequence in range(LAG + 1):
        assert stage.published_smoothed == []
        stage.announce(header(sequence))
        stage.smooth(header(sequence), *(stage.smoothed(c, sequence, lag=0) for c in (0, 2)))
    assert stage.published_smoothed == [(0, stage.smoothed_as(0, 1), 0)]
    finish(stage, LAG + 1)
    smoothed = [(s, stage.smoothed_as(s, 1), 0) for s in range(LAG + 1)]
    assert stage.published_smoothed == smoothed


def test_the_end_waits_for_what_living_channels_have_and_no_longer_than_the_deadline(
    stage: Stage,
) -> None:
    stage.announce(header(0))
    stage.answer((0, 1, 2), header(0))
    stage.handle(KEYS.feature, header(1, end=True))
    assert stage.matches.sequences == [0, 1]
    stage.smooth(header(1, end=True), stage.smoothed(0, 0, lag=0))
    stage.pass_time(0.75 * DEADLINE_S)
    stage.smooth(header(1, end=True), stage.smoothed(2, 0, lag=0))
    stage.pass_time(0.75 * DEADLINE_S)
    assert not stage.smoothed_matches.sent
    assert stage.acks.sequences == [0]
    stage.pass_time(0.5 * DEADLINE_S)
    assert stage.published_smoothed == [(0, stage.smoothed_as(0, 1), 0)]
    assert stage.acks.sequences == [0, 1]


def test_the_end_does_not_wait_for_a_dead_channel(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer((0, 1, 2), header(0))
    stage.set_alive(1, False)
    stage.handle(KEYS.feature, header(1, end=True))
    stage.smooth(header(1, end=True), *(stage.smoothed(c, 0, lag=0) for c in (0, 2)))
    assert stage.published_smoothed == [(0, stage.smoothed_as(0, 1), 0)]
    assert stage.acks.sequences == [0, 1]


def test_an_end_that_comes_again_is_answered_again(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer((0, 1, 2), header(0))
    finish(stage, 1, 0)
    stage.handle(KEYS.feature, header(1, end=True))
    assert stage.matches.sequences == stage.smoothed_matches.sequences == [0, 1, 1]
    assert stage.acks.sequences == [0, 1, 1]


def test_frames_that_a_live_stream_dropped_are_not_smoothed(stage: Stage) -> None:
    for sequence in (0, 2, 5):
        stage.announce(header(sequence, live=True))
        before = range(max(0, sequence - 2), sequence + 1)
        smoothed = [stage.smoothed(c, s, sequence - s) for s in before for c in ALL]
        stage.smooth(header(sequence, live=True), *smoothed)
    assert [sequence for sequence, *_ in stage.published_smoothed] == [0, 2, 5]


def test_another_stream_leaves_no_frame_without_its_smoothed_match(stage: Stage) -> None:
    for sequence in range(2):
        stage.announce(header(sequence))
        stage.answer((0, 1, 2), header(sequence))
    stage.announce(header(0, stream="next"))
    assert [sequence for sequence, *_ in stage.published_smoothed] == [0, 1]


def test_shards_are_joined_before_channels_are(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer((0, 1, 2), header(0))
    half = stage.places // 2
    for shard in range(2):
        smoothed = []
        for frame in (stage.smoothed(channel, 0, lag=0) for channel in ALL):
            whole = frame.candidate
            own = (whole.places < half) == (shard == 0)
            places, belief = whole.places[own], whole.evidence[own]
            best = int(np.argmax(belief))
            part = Candidate(int(places[best]), float(belief[best]), places, belief)
            smoothed.append(frame._replace(candidate=part))
        stage.handle(
            KEYS.candidates(f"worker{shard}"),
            header(1),
            CandidatesMessage(
                map=stage.map,
                rule="filter",
                shard=shard,
                shards=2,
                candidates=(stage.written(shard, 1),),
                smoothed=SmoothedFrames.of(1, smoothed),
            ),
        )
    ((sequence, match, lag),) = stage.published_smoothed
    assert (sequence, lag) == (0, 0)
    assert match.place == stage.smoothed_as(0).place
    assert match.score == pytest.approx(stage.smoothed_as(0).score, abs=1e-3)


def test_what_was_smoothed_on_another_map_or_with_another_lag_is_refused(stage: Stage) -> None:
    stage.announce(header(0))
    foreign = Candidate(
        stage.places, 0.5, np.array([stage.places], np.int32), np.ones(1, np.float32)
    )
    with pytest.raises(MessageError, match="another map"):
        stage.smooth(header(0), stage.smoothed(0, 0, 0)._replace(candidate=foreign))
    with pytest.raises(MessageError, match=r"matching\.lag"):
        stage.smooth(header(0), stage.smoothed(0, 0, LAG + 1))
    assert not stage.published_smoothed


def test_a_fuser_that_comes_back_smooths_what_the_one_before_it_may_not_have(
    stage: Stage,
) -> None:
    feature = FeatureMessage(model="m", descriptor=None).encode()
    stage.elsewhere.kept = {s: (header(s), feature) for s in range(10)}
    for sequence in range(10):
        about = header(sequence)
        frames = [stage.smoothed(c, sequence - 2, 2) for c in ALL] if sequence > 1 else []
        message = stage.message_of_smoothed(about, *frames) if frames else None
        if message is not None:
            stage.remembered.append((about, message.encode()))
    stage.announce(header(10, oldest=8))  # what was sent before the other one had answered 8
    stage.announce(header(11, oldest=10))
    expected = [(s, stage.smoothed_as(s), 2) for s in (5, 6, 7)]
    assert stage.published_smoothed == expected
    for sequence in (10, 11):
        smooth_in_all(stage, header(sequence, oldest=10), sequence - 2, lag=2)
    assert stage.matches.sequences == [10, 11]
    expected += [(s, stage.smoothed_as(s), 2) for s in (8, 9)]
    assert stage.published_smoothed == expected


def test_so_does_one_that_comes_back_when_only_the_end_is_awaited(stage: Stage) -> None:
    feature = FeatureMessage(model="m", descriptor=None).encode()
    stage.elsewhere.kept = {s: (header(s), feature) for s in range(5)}
    end = header(5, end=True, oldest=5)
    finished = stage.message_of_smoothed(
        end, *(stage.smoothed(c, s, 4 - s) for s in range(1, 5) for c in ALL)
    )
    stage.remembered.append((end, finished.encode()))
    stage.handle(KEYS.feature, end)
    assert [sequence for sequence, *_ in stage.published_smoothed] == [2, 3, 4]
    assert stage.smoothed_matches.sequences[-1] == stage.acks.sequences[-1] == 5
