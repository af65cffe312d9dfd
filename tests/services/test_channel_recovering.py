import pytest
from bus_doubles import header
from channel_stage import RULES, RUNS, Descriptor, Stage, offline, smoothed_offline

from placefield.config import MatchingConfig, Rule
from placefield.maps.map import Map
from placefield_services import channel_worker as worker_module


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("rule", RULES)
def test_a_restarted_worker_answers_as_if_it_had_never_been_away(
    route_map: Map, descriptors: list[Descriptor], rule: Rule, live: bool
) -> None:
    stage = Stage(route_map, rule)
    stage.remember_elsewhere(descriptors, live=live)
    for sequence in range(12, len(descriptors)):
        stage.send(header(sequence, live=live, oldest=0 if live else 10), descriptors[sequence])
    awaited = 12 if live else 10
    assert stage.candidates(0) == offline(route_map, 0, rule, [*descriptors])[awaited:]
    assert stage.counts[RUNS[0]]["gaps"] == 0
    stage.handle(stage.feature(header(len(descriptors), end=True, live=live)))
    newest = (12 if live else 10) - 1  # that was answered while it was away
    expected = smoothed_offline(route_map, 0, rule, [*descriptors])
    awaited_still = [each for each in expected if each[0] + MatchingConfig().lag > newest]
    assert stage.smoothed(0) == awaited_still


@pytest.mark.parametrize("rule", RULES)
def test_a_missed_lossless_frame_is_fetched(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    stage.remember_elsewhere(descriptors)
    for sequence, descriptor in enumerate(descriptors):
        if sequence not in (4, 5, 11):
            stage.send(header(sequence), descriptor)
    assert stage.candidates(0) == offline(route_map, 0, rule, [*descriptors])
    assert stage.counts[RUNS[0]]["gaps"] == 0
    assert stage.counts[RUNS[0]]["fetched"] == 3


@pytest.mark.parametrize("known", [0, 5, 11])
def test_a_restarted_worker_without_frames_that_no_cache_has_marks_every_answer_as_forgotten(
    route_map: Map, descriptors: list[Descriptor], known: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_module, "_ASK_FOR_S", 0.0)
    knows, lacks = Stage(route_map, "filter"), Stage(route_map, "filter")
    knows.remember_elsewhere(descriptors[:12])
    lacks.remember_elsewhere(descriptors[:known])
    for stage in (knows, lacks):
        for sequence in range(12, 16):
            stage.send(header(sequence, oldest=12), descriptors[sequence])
        stage.send(header(0, stream="next"), descriptors[0])
    flags = [
        [message.forgotten for _, message in stage.publishers[RUNS[0]].sent if message]
        for stage in (knows, lacks)
    ]
    assert flags == [[False] * 5, [True] * 4 + [False]]


def test_a_lossless_frame_that_no_cache_has_marks_all_later_answers_as_forgotten(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_module, "_ASK_FOR_S", 0.0)
    stage = Stage(route_map, "filter")
    for sequence in (0, 1, 3, 4):
        stage.send(header(sequence), descriptors[sequence])
    flags = [message.forgotten for _, message in stage.publishers[RUNS[0]].sent if message]
    assert flags == [False, False, True, True]


def test_a_worker_waits_for_frames_that_may_still_be_fetched(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_module, "_ASK_FOR_S", 1000.0)
    stage = Stage(route_map, "filter")
    for sequence in (0, 1, 4, 5):
        stage.send(header(sequence), descriptors[sequence])
    assert stage.publishers[RUNS[0]].sequences == [0, 1]
    assert stage.counts[RUNS[0]]["out_of_order"] == 2
    stage.remember_elsewhere(descriptors)
    stage.send(header(6), descriptors[6])
    assert stage.candidates(0) == offline(route_map, 0, "filter", [*descriptors[:7]])


def test_a_frame_that_comes_again_is_answered_again_and_matched_once(
    route_map: Map, descriptors: list[Descriptor]
) -> None:
    stage = Stage(route_map, "filter")
    for sequence in (0, 1, 2, 1, 2, 3):
        stage.send(header(sequence), descriptors[sequence])
    expected = offline(route_map, 0, "filter", [*descriptors])
    assert stage.candidates(0) == [*expected[:3], *expected[1:4]]
