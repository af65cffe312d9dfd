from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bus_doubles import Memory, RecordingPublisher, header, received

from placefield.bus.history import History, Outbox
from placefield.bus.keys import Keys, Part
from placefield.bus.messages import (
    CandidatesMessage,
    ChannelCandidate,
    FeatureMessage,
    Header,
    HistoryQuery,
    MatchMessage,
    Message,
)
from placefield.config import Config, Rule
from placefield.errors import MessageError
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.maps.map import Map
from placefield.matching.candidate import NO_EVIDENCE, NO_PLACES, Candidate
from placefield_services import fuser as fuser_module
from placefield_services.fuser import Fuser
from placefield_services.live_channels import LiveChannels

KEYS = Keys("test")
CANDIDATES = KEYS.candidates("worker")
DEADLINE_S = 2.0
CHANNELS = 3

Held = Callable[[int], tuple[np.ndarray, np.ndarray]]
"""Makes the places and evidence of a candidate, for a map of so many places."""


class Clock:
    """Time that passes when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


class Stage:
    """A fuser, what it published and what it counted."""

    def __init__(self, placemap: Map, clock: Clock, rule: Rule = "filter") -> None:
        self.places = placemap.places.count
        self.config = Config.model_validate(
            {"runs": ["test"], "matching": {"rule": rule}, "fusion": {"deadline_s": DEADLINE_S}}
        )
        self.channels = LiveChannels(CHANNELS)
        for channel in range(CHANNELS):
            self.set_alive(channel, True)
        self.matches, self.acks = RecordingPublisher(MatchMessage), RecordingPublisher(MatchMessage)
        self.features, self.elsewhere = History(), Memory()
        unasked = fuser_module.Memory(History(), Memory().recall)
        self.counts: Counter[str] = Counter()
        self._clock = clock
        self._fuser = Fuser(
            placemap,
            self.config,
            KEYS,
            self.channels,
            (fuser_module.Memory(self.features, self.elsewhere.recall), unasked),
            Outbox(self.matches, History()),
            self.acks,
            self.counts,
        )

    def set_alive(self, channel: int, is_alive: bool) -> None:
        token = KEYS.alive("channel", Part(channel).identity("worker"))
        self.channels.change(token, is_alive)

    def handle(self, key: str, about: Header, message: Message | bytes = b"") -> None:
        self._fuser.handle(received(key, about, message))
        self._fuser.release()

    def announce(self, about: Header) -> None:
        self.handle(KEYS.feature, about, FeatureMessage(model="m", descriptor=None))

    def candidate(self, channel: int, sequence: int) -> Candidate:
        """Return a candidate that believes in some of the places."""
        rng = np.random.default_rng([channel, sequence])
        evidence = rng.dirichlet(np.full(self.places // 3, 0.1)).astype(np.float32)
        places = np.sort(rng.permutation(self.places)[: len(evidence)]).astype(np.int32)
        best = int(np.argmax(evidence))
        return Candidate(int(places[best]), float(evidence[best]), places, evidence)

    def written(self, channel: int, sequence: int, **changes: Any) -> ChannelCandidate:
        return ChannelCandidate(
            **(vars(self.candidate(channel, sequence)) | {"channel": channel} | changes)
        )

    def message(self, *candidates: ChannelCandidate, rule: Rule | None = None) -> CandidatesMessage:
        return CandidatesMessage(rule=rule or self.config.matching.rule, candidates=candidates)

    def answer(self, channels: int | tuple[int, ...], about: Header) -> None:
        """Let one worker answer, of one channel or several."""
        numbers = channels if isinstance(channels, tuple) else (channels,)
        candidates = [self.written(channel, about.sequence) for channel in numbers]
        self.handle(CANDIDATES, about, self.message(*candidates))

    def pass_time(self, seconds: float) -> None:
        self._clock.now += seconds
        self._fuser.release()

    def expected(self, sequence: int, *missing: int) -> Match:
        answering = sorted({*range(CHANNELS)} - {*missing})
        candidates = [self.candidate(channel, sequence) for channel in answering]
        return fuse(candidates, self.config.matching, missing=missing)

    @property
    def published(self) -> list[tuple[int, Match]]:
        return [
            (about.sequence, message.match)
            for about, message in self.matches.sent
            if isinstance(message, MatchMessage)
        ]


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


def test_the_stream_ends_behind_its_last_answer(stage: Stage) -> None:
    stage.announce(header(0))
    stage.handle(KEYS.feature, header(1, end=True))
    assert not stage.matches.sent
    for channel in range(CHANNELS):
        stage.handle(CANDIDATES, header(1, end=True))
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
        (CANDIDATES, stage.message(stage.written(0, 0), rule="lowest-score"), "--rule"),
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
        ("lowest-score", [nothing], [belief, value_of_every_place]),
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


def test_a_frame_whose_answer_was_lost_is_answered_again(stage: Stage) -> None:
    for sequence in range(3):
        stage.announce(header(sequence))
        stage.answer((0, 1, 2), header(sequence))
    stage.announce(header(1, oldest=1))
    assert [sequence for sequence, _ in stage.published] == [0, 1, 2, 1]
    assert stage.published[3] == stage.published[1]
    assert stage.acks.sequences == [0, 1, 2, 1]


def test_one_that_comes_back_begins_with_the_oldest_frame_that_is_awaited(stage: Stage) -> None:
    stage.announce(header(7, oldest=5))
    stage.answer((0, 1, 2), header(7, oldest=5))
    stage.pass_time(1000)
    assert stage.published == []
    for sequence in (5, 6):
        stage.announce(header(sequence, oldest=5))
        stage.answer((0, 1, 2), header(sequence, oldest=5))
    assert [sequence for sequence, _ in stage.published] == [5, 6, 7]


def test_descriptors_are_remembered_for_who_asks(stage: Stage) -> None:
    for sequence in range(3):
        stage.announce(header(sequence))
    query = HistoryQuery(stream="s", first=1, end=9).encode()
    told = [Header.decode(attachment).sequence for _, attachment in stage.features.reply(query)]
    assert told == [1, 2]


def test_one_that_comes_back_learns_what_others_remember(stage: Stage) -> None:
    message = FeatureMessage(model="m", descriptor=None).encode()
    stage.elsewhere.kept = {sequence: (header(sequence), message) for sequence in range(5)}
    stage.announce(header(5, oldest=5))
    query = HistoryQuery(stream="s", first=0, end=9).encode()
    told = [Header.decode(attachment).sequence for _, attachment in stage.features.reply(query)]
    assert told == [0, 1, 2, 3, 4, 5]


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
        message = CandidatesMessage(rule="filter", shard=shard, shards=3, candidates=(written,))
        stage.handle(KEYS.candidates(f"worker{shard}"), header(0), message)
    ((sequence, match),) = stage.published
    expected = stage.expected(0)
    assert (sequence, match.place, match.missing) == (0, expected.place, ())
    assert match.score == pytest.approx(expected.score, abs=1e-3)  # the next to nothing is dropped


def test_a_stream_is_not_over_before_its_last_frames_have_been_heard_of(stage: Stage) -> None:
    stage.announce(header(0))
    stage.answer((0, 1, 2), header(0))
    stage.handle(KEYS.feature, header(2, end=True))
    stage.pass_time(1000)
    assert [about.sequence for about, _ in stage.matches.sent] == [0]
    stage.announce(header(1))
    stage.answer((0, 1, 2), header(1))
    assert [about.sequence for about, _ in stage.matches.sent] == [0, 1, 2]
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
        patch.setattr(fuser_module, "fuse", lambda *_, **__: 1 // 0)
        stage.announce(header(0))
        stage.answer((0, 1, 2), header(0))
    stage.announce(header(1))
    stage.answer((0, 1, 2), header(1))
    assert [match.place for _, match in stage.published] == [-1, stage.expected(1).place]
    assert stage.published[0][1].missing == (0, 1, 2)
    assert stage.counts["failed"] == 1
