"""A channel worker whose map gets a new version while frames stream."""

import gc
from dataclasses import replace
from pathlib import Path
from weakref import ref

import pytest
from bus_doubles import header
from channel_stage import RULES, RUNS, Descriptor, Stage, offline, smoothed_offline
from map_versions import version_of

from placefield.config import MatchingConfig, Rule
from placefield.maps.map import Map
from placefield_services import run_versions


@pytest.fixture(scope="module")
def version(route_map: Map, reference_dir: Path) -> Map:
    return version_of(route_map, reference_dir, 1)


def send(stage: Stage, descriptors: list[Descriptor], first: int, *, live: bool = False) -> None:
    """Send frames from ``first`` on, one by one, with two of them under way."""
    for sequence, descriptor in enumerate(descriptors[first:], first):
        oldest = 0 if live else max(0, sequence - 1)
        stage.send(header(sequence, live=live, oldest=oldest), descriptor)
        stage.after_batch()


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("rule", RULES)
def test_frames_are_answered_under_both_versions_as_if_each_had_seen_all_frames(
    route_map: Map, version: Map, descriptors: list[Descriptor], rule: Rule, live: bool
) -> None:
    stage = Stage(route_map, rule)
    send(stage, descriptors[:10], 0, live=live)
    stage.offer(version)
    send(stage, descriptors, 10, live=live)
    stage.handle(
        stage.feature(header(len(descriptors), end=True, live=live, oldest=len(descriptors)))
    )
    for _ in range(len(descriptors)):
        stage.after_batch()
    old, new = (stage.candidates(0, of=each.digest) for each in (route_map, version))
    assert old == offline(route_map, 0, rule, [*descriptors])
    expected = offline(version, 0, rule, [*descriptors])
    assert new == expected[-len(new) :]
    assert new[0][0] <= 11, "it catches up with the stream"
    assert old[-1] != new[-1]
    newest = new[0][0] - 1  # that was answered by the old version alone
    in_hindsight = smoothed_offline(version, 0, rule, [*descriptors])
    awaited = [each for each in in_hindsight if each[0] + MatchingConfig().lag > newest]
    assert stage.smoothed(0, of=version.digest) == awaited


def test_when_the_fuser_answers_by_the_new_version_the_old_one_is_freed(
    route_map: Map, version: Map, descriptors: list[Descriptor]
) -> None:
    copies = tuple(
        replace(channel, metric=replace(channel.metric)) for channel in route_map.channels
    )
    stage = Stage(replace(route_map, channels=copies), "filter")
    freed = ref(copies[0].metric)
    del copies
    send(stage, descriptors[:5], 0)
    stage.offer(version)
    send(stage, descriptors[:10], 5)
    stage.after_batch(answering=route_map.digest)
    assert stage.answering() == route_map.digest
    for run in RUNS:
        stage.after_batch(answering=version.digest, run=run)
        assert stage.answering(run) == version.digest
    send(stage, descriptors, 10)
    assert stage.candidates(0, of=route_map.digest)[-1][0] == 9
    assert (
        stage.candidates(0, of=version.digest)[-10:]
        == offline(version, 0, "filter", [*descriptors])[-10:]
    )
    gc.collect()
    assert freed() is None


def test_a_version_displaces_one_that_the_fuser_has_not_gone_over_to(
    route_map: Map, version: Map, reference_dir: Path, descriptors: list[Descriptor]
) -> None:
    newest = version_of(route_map, reference_dir, 2)
    stage = Stage(route_map, "filter")
    send(stage, descriptors[:5], 0)
    stage.offer(version)
    stage.offer(newest)
    stage.after_batch(answering=version.digest)
    assert stage.answering() == route_map.digest
    send(stage, descriptors, 5)
    assert not stage.candidates(0, of=version.digest)
    expected = offline(newest, 0, "filter", [*descriptors])
    assert stage.candidates(0, of=newest.digest)[-10:] == expected[-10:]
    stage.offer(route_map)  # it was put back
    stage.after_batch(answering=newest.digest)
    assert stage.answering() == route_map.digest


def test_a_frame_that_comes_again_is_answered_again_under_both_versions(
    route_map: Map, version: Map, descriptors: list[Descriptor]
) -> None:
    stage = Stage(route_map, "filter")
    send(stage, descriptors[:5], 0)
    stage.offer(version)
    send(stage, descriptors[:9], 5)
    for each in (route_map, version):
        before = stage.candidates(0, of=each.digest)
        stage.send(header(8, oldest=8), descriptors[8])
        assert stage.candidates(0, of=each.digest)[len(before) :] == before[-1:]


def test_the_frames_of_the_past_are_matched_a_few_at_a_time(
    route_map: Map, version: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_versions, "_CATCH_UP_S", 0.0)
    stage = Stage(route_map, "filter")
    send(stage, descriptors, 0)
    stage.offer(version)
    answered = []
    for _ in range(4):
        answered.append(len(stage.candidates(0, of=version.digest)))
        stage.after_batch()
    assert answered == [0, 0, 0, 2], "the two frames under way are the last of twenty"
