"""Exploring workers answer as the library does, whatever they missed."""

from collections import Counter
from functools import cache

import numpy as np
import pytest
from bus_doubles import PeerCache, RecordingPublisher, at_last, received
from exploring_drive import CONFIG, FRAMES, MODEL, about, features, message, offline

from placefield.bus.candidate_messages import CandidatesMessage, FinishedMessage
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.errors import MessageError, OtherMapError
from placefield.matching.explored_candidate import to_answer
from placefield.matching.exploring import Answer, SmoothedAnswer
from placefield_services import whole_stream
from placefield_services.exploring_channel import ExploringOutputs, ExploringWorker

KEY = Keys("test").feature
RAWS = features()


@cache  # not on import: each worker of pytest would wait for the compiler
def expected() -> tuple[list[Answer], list[SmoothedAnswer]]:
    """Return what the library answers to all frames, causal and smoothed."""
    return offline(RAWS)


@pytest.fixture(autouse=True)
def ask_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_stream, "_ASK_FOR_S", 0.0)


class Stage:
    """A worker, what it published and what it counted."""

    def __init__(self) -> None:
        self.publisher = RecordingPublisher(CandidatesMessage, FinishedMessage)
        self.elsewhere, self.features = PeerCache(), ReplayCache()
        self.counts: Counter[str] = Counter()
        candidates = CachedPublisher(self.publisher, ReplayCache())
        outputs = ExploringOutputs(candidates, self.features, self.elsewhere.fetch)
        self._worker = ExploringWorker(MODEL, CONFIG, outputs, self.counts)

    def handle(self, header: Header, payload: bytes = b"") -> None:
        at_last(lambda: self._worker.accept(received(KEY, header, payload)))

    def drive(self, first: int, end: int, *, oldest: int = 0, live: bool = False) -> None:
        for sequence in range(first, end):
            self.handle(about(sequence, oldest=oldest, live=live), message(RAWS[sequence]))
        if end == FRAMES:
            self.handle(about(FRAMES, oldest=oldest, live=live, end=True))

    def remember(self, first: int, end: int) -> None:
        """Let another service have these features."""
        for sequence in range(first, end):
            self.elsewhere.kept[sequence] = about(sequence), message(RAWS[sequence])

    @property
    def causal(self) -> dict[int, Answer]:
        return {
            header.sequence: to_answer(sent.candidates[0].candidate, CONFIG)
            for header, sent in self.publisher.sent
            if isinstance(sent, CandidatesMessage)
        }

    @property
    def smoothed(self) -> list[SmoothedAnswer]:
        return [
            SmoothedAnswer(each.sequence, each.lag, to_answer(each.candidate, CONFIG))
            for header, sent in self.publisher.sent
            if isinstance(sent, CandidatesMessage | FinishedMessage) and sent.smoothed is not None
            for each in sent.smoothed.frames(header.sequence)
        ]

    @property
    def forgets(self) -> list[bool]:
        return [
            sent.forgotten for _, sent in self.publisher.sent if isinstance(sent, CandidatesMessage)
        ]


def test_the_drive_is_explored_as_the_library_does_to_the_bit() -> None:
    stage = Stage()
    stage.drive(0, FRAMES)
    assert [*stage.causal.values()] == expected()[0]
    assert stage.smoothed == expected()[1]
    assert sum(answer.known for answer in expected()[0]) > 40


@pytest.mark.parametrize("start", [1, 90, 130])
def test_a_worker_that_starts_during_the_stream_goes_on_as_if_it_had_always_been_there(
    start: int,
) -> None:
    stage = Stage()
    stage.remember(0, start)
    stage.drive(start, FRAMES, oldest=start)
    assert stage.counts["fetched"] == start
    assert [*stage.causal] == [*range(start, FRAMES)]
    assert [*stage.causal.values()] == expected()[0][start:]
    missed = {each.frame for each in expected()[1]} - {each.frame for each in stage.smoothed}
    assert all(frame < start for frame in missed)
    assert set(stage.smoothed) <= set(expected()[1])
    assert not any(stage.forgets)


def test_fetched_frames_are_answered_if_their_source_waits_for_them() -> None:
    stage = Stage()
    stage.remember(0, 60)
    stage.handle(about(60, oldest=55), message(RAWS[60]))
    assert [*stage.causal] == [*range(55, 61)]
    assert [*stage.causal.values()] == expected()[0][55:61]


def test_frames_that_nobody_has_are_not_observed_and_the_answers_say_so() -> None:
    lost = range(70, 75)
    raws = [None if number in lost else raw for number, raw in enumerate(RAWS)]
    stage = Stage()
    stage.drive(0, 70)
    stage.drive(75, FRAMES, oldest=75)
    assert [*stage.causal.values()] == [*offline(raws)[0][:70], *offline(raws)[0][75:]]
    assert stage.forgets == [False] * 70 + [True] * (FRAMES - 75)
    assert stage.counts["gaps"] == len(lost)


def test_a_live_stream_may_have_gaps_without_a_loss() -> None:
    stage = Stage()
    stage.drive(0, 70, live=True)
    stage.drive(75, FRAMES, live=True)
    assert not any(stage.forgets)
    assert len(stage.causal) == FRAMES - 5


def test_a_gap_of_any_length_takes_no_time_and_the_places_stay_known() -> None:
    stage, far = Stage(), 2**30
    stage.drive(0, 80, live=True)
    for number, raw in enumerate(RAWS[80:], far):
        stage.handle(about(number, live=True), message(raw))
    found = [answer.place for answer in stage.causal.values() if answer.known]
    assert len(found) > 30
    assert max(found) < 80


def test_a_frame_that_comes_again_gets_the_same_answer_again() -> None:
    stage = Stage()
    stage.drive(0, 50)
    stage.handle(about(49), message(RAWS[49]))
    (_, first), (_, again) = stage.publisher.sent[-2:]
    assert first is not None
    assert again is not None
    assert first.encode() == again.encode()
    assert stage.counts["repeated"] == 1


def test_a_feature_that_the_drive_cannot_have_is_refused_and_its_frame_answered() -> None:
    raws = [*RAWS]
    raws[30] = None
    stage = Stage()
    stage.drive(0, 30)
    stage.handle(about(30), message(np.ones(7, np.float32)))
    stage.drive(31, FRAMES)
    assert stage.counts["malformed"] == 1
    assert [*stage.causal.values()] == offline(raws)[0]


def test_messages_that_cannot_be_of_this_exploration_are_refused() -> None:
    stage = Stage()
    with pytest.raises(OtherMapError, match=r"features\.kind"):
        stage.handle(about(0), message(RAWS[0], model="another"))
    with pytest.raises(MessageError, match="frames at most"):
        stage.handle(about(2**31), message(RAWS[0]))
    stage.drive(0, 5)
    assert len(stage.causal) == 5


def test_a_new_stream_knows_no_place_of_the_one_before() -> None:
    stage = Stage()
    stage.drive(0, FRAMES)
    stage.publisher.sent.clear()
    for number, raw in enumerate(RAWS):
        stage.handle(about(number).model_copy(update={"stream": "next"}), message(raw))
    assert [*stage.causal.values()] == expected()[0]
