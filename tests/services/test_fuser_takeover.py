"""A fuser whose map gets a new version while frames stream."""

from dataclasses import replace

import pytest
from bus_doubles import header
from fuser_stage import CANDIDATES, CHANNELS, LAG, Clock, Stage

from placefield.errors import MessageError, OtherMapError
from placefield.maps.map import Map
from placefield_services import fuser_run as fuser_module

ALL = tuple(range(CHANNELS))
NEW, NEWEST = "1" * 16, "2" * 16


@pytest.fixture
def stage(route_map: Map, monkeypatch: pytest.MonkeyPatch) -> Stage:
    clock = Clock()
    monkeypatch.setattr(fuser_module, "time", clock)
    return Stage(route_map, clock)


@pytest.fixture
def version(route_map: Map) -> Map:
    return replace(route_map, digest=NEW)


def answer(stage: Stage, sequence: int, *of: str, smooths: int | None = None) -> None:
    """Let a frame come, and be answered by all channels under each of these maps.

    ``smooths``: the frame that each channel has smoothed with that; None: none.
    """
    stage.announce(header(sequence))
    smoothed = [] if smooths is None else [stage.smoothed(each, smooths, 0) for each in ALL]
    for digest in of:
        message = (
            stage.message_of_smoothed(header(sequence), *smoothed)
            if smoothed
            else stage.message(*(stage.written(each, sequence) for each in ALL))
        )
        stage.handle(CANDIDATES, header(sequence), message.model_copy(update={"map": digest}))


def maps(stage: Stage) -> str:
    """Return by which map each frame was answered: ``o`` the first one, ``n`` the new one."""
    return "".join("n" if message.map == NEW else "o" for _, message in stage.matches.sent)


def test_the_first_frame_after_all_earlier_ones_are_smoothed_is_answered_by_the_new_version(
    stage: Stage, version: Map
) -> None:
    answer(stage, 0, stage.map)
    stage.offer(version)
    for sequence in range(1, 8):
        answer(stage, sequence, stage.map, NEW)
    # Frame 0 is smoothed, without its channels, when LAG further frames are answered.
    assert maps(stage) == "o" * (LAG + 1) + "n" * (7 - LAG)
    assert stage.published == [(sequence, stage.expected(sequence)) for sequence in range(8)]
    assert [number for number, _, _ in stage.published_smoothed] == list(range(8 - LAG))
    assert stage.counts["stale"] == 7 - LAG
    assert stage.counts["partial"] == stage.counts["late"] == stage.counts["other_map"] == 0


def test_frames_that_are_smoothed_at_once_are_smoothed_once_and_by_all_channels(
    stage: Stage, version: Map
) -> None:
    answer(stage, 0, stage.map, smooths=0)
    stage.offer(version)
    for sequence in range(1, 5):
        answer(stage, sequence, stage.map, NEW, smooths=sequence)
    assert maps(stage) == "oonnn"
    expected = [(sequence, stage.smoothed_as(sequence), 0) for sequence in range(5)]
    assert stage.published_smoothed == expected


def test_frames_that_the_old_version_has_not_answered_are_answered_once_by_the_new_one(
    stage: Stage, version: Map
) -> None:
    stage.offer(version)
    for sequence in range(3):
        answer(stage, sequence, NEW)
    assert maps(stage) == "nnn"
    stage.answer(ALL, header(0))
    assert stage.counts["stale"] == 1
    assert stage.published == [(sequence, stage.expected(sequence)) for sequence in range(3)]


def test_a_version_that_a_living_channel_does_not_answer_by_is_not_gone_over_to(
    stage: Stage, version: Map
) -> None:
    stage.offer(version)
    for sequence in range(3 * LAG):
        answer(stage, sequence, stage.map)
        some = stage.message(*(stage.written(each, sequence) for each in ALL[:-1]))
        stage.handle(CANDIDATES, header(sequence), some.model_copy(update={"map": NEW}))
    assert maps(stage) == "o" * 3 * LAG
    stage.set_alive(ALL[-1], False)
    answer(stage, 3 * LAG, NEW)
    assert stage.answering == NEW


def test_a_version_that_was_replaced_itself_is_not_gone_over_to(
    stage: Stage, route_map: Map, version: Map
) -> None:
    stage.offer(version, lambda: False)
    for sequence in range(3):
        answer(stage, sequence, stage.map, NEW, smooths=sequence)
    assert maps(stage) == "ooo"
    stage.offer(replace(route_map, digest=NEWEST))
    with pytest.raises(OtherMapError):
        answer(stage, 3, stage.map, NEW)
    for sequence in range(4, 8):
        answer(stage, sequence, stage.map, NEWEST, smooths=sequence)
    assert stage.answering == NEWEST


def test_streams_of_one_frame_go_over_to_the_new_version_too(stage: Stage, version: Map) -> None:
    stage.offer(version)
    for stream in ("a", "b"):
        about = header(0, stream=stream)
        stage.announce(about)
        for digest in (stage.map, NEW):
            message = stage.message(*(stage.written(each, 0) for each in ALL))
            stage.handle(CANDIDATES, about, message.model_copy(update={"map": digest}))
        stage.handle("placefield/test/feature", header(1, stream=stream, end=True))
    sent = [message.map for _, message in stage.matches.sent if message is not None]
    assert sent == [stage.map, NEW]


def test_candidates_of_another_map_and_of_another_size_are_refused_under_the_new_version(
    stage: Stage, route_map: Map
) -> None:
    shorter = replace(route_map.places, same=route_map.places.same[:10])
    stage.offer(replace(route_map, digest=NEW, places=shorter))
    stage.announce(header(0))
    message = stage.message(stage.written(0, 0, place=30)).model_copy(update={"map": NEW})
    with pytest.raises(MessageError, match="candidate of another map"):
        stage.handle(CANDIDATES, header(0), message)


def test_a_worker_that_was_started_again_and_has_the_new_version_alone_is_not_waited_for(
    stage: Stage, version: Map
) -> None:
    answer(stage, 0, stage.map)
    stage.offer(version)
    stage.announce(header(1))
    some = stage.message(*(stage.written(each, 1) for each in ALL[:-1]))
    stage.handle(CANDIDATES, header(1), some)
    assert maps(stage) == "o"
    message = stage.message(*(stage.written(each, 1) for each in ALL))
    stage.handle(CANDIDATES, header(1), message.model_copy(update={"map": NEW}))
    assert maps(stage) == "on"
    assert stage.counts["partial"] == 0
