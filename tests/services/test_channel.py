import threading
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from bus_doubles import header, received
from channel_stage import RULES, RUNS, Descriptor, Stage, offline, smoothed_offline
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from placefield.bus.candidate_messages import CandidatesMessage, FinishedMessage
from placefield.bus.keys import Keys
from placefield.bus.messages import FeatureMessage
from placefield.config import Config, Rule
from placefield.errors import ConfigError, MessageError
from placefield.maps.map import Map
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield.matching.filter_matcher import FilterMatcher
from placefield.matching.matcher import Partial
from placefield.matching.roads import RouteCells
from placefield_services.channel import run_channels
from placefield_services.map_versions import MapVersions


@pytest.mark.parametrize("rule", RULES)
def test_each_channel_answers_each_frame_as_its_matcher_does(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    for sequence, descriptor in enumerate(descriptors):
        stage.send(header(sequence), descriptor)
    for channel in stage.channels:
        assert stage.candidates(channel) == offline(route_map, channel, rule, [*descriptors])
    assert any(place >= 0 for _, place, *_ in stage.candidates(0))


@pytest.mark.parametrize("rule", RULES)
def test_frames_that_did_not_come_are_missing_observations(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    missing = {4, 5, 6, 11}
    for sequence, descriptor in enumerate(descriptors):
        if sequence not in missing:
            stage.send(header(sequence), descriptor)
    observed = [None if s in missing else descriptor for s, descriptor in enumerate(descriptors)]
    expected = [c for c in offline(route_map, 0, rule, observed) if c[0] not in missing]
    assert stage.candidates(0) == expected
    assert stage.counts[RUNS[0]]["gaps"] == len(missing)


@pytest.mark.parametrize("rule", RULES)
def test_after_any_gap_an_answer_is_as_quick_as_ever(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    stage.send(header(0), descriptors[0])
    stage.send(header(2**40), descriptors[1])  # frame by frame, the gap would take for ever
    assert [sequence for sequence, *_ in stage.candidates(0)] == [0, 2**40]


@pytest.mark.parametrize("rule", RULES)
def test_a_frame_that_could_not_be_read_is_answered(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    observed: list[Descriptor | None] = [*descriptors]
    observed[0] = observed[7] = None
    for sequence, descriptor in enumerate(observed):
        stage.send(header(sequence), descriptor)
    assert stage.candidates(2) == offline(route_map, 2, rule, observed)


@pytest.mark.parametrize("rule", RULES)
def test_a_new_stream_begins_afresh(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    for stream in ("first", "second"):
        for sequence, descriptor in enumerate(descriptors):
            stage.send(header(sequence, stream=stream), descriptor)
    candidates = stage.candidates(0)
    assert candidates[: len(descriptors)] == candidates[len(descriptors) :]


@pytest.mark.parametrize("rule", RULES)
def test_a_frame_is_answered_by_one_message_of_all_channels(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    stage.send(header(0), descriptors[0])
    ((about, message),) = stage.publishers[RUNS[0]].sent
    assert about == header(0)
    assert isinstance(message, CandidatesMessage)
    assert message.rule == rule
    assert tuple(each.channel for each in message.candidates) == stage.channels


def test_the_end_of_the_stream_is_passed_on(route_map: Map) -> None:
    stage = Stage(route_map, "evidence")
    stage.handle(stage.feature(header(0, end=True)))
    finished = FinishedMessage(map=route_map.digest, rule="evidence", channels=(0, 2))
    assert stage.publishers[RUNS[0]].sent == [(header(0, end=True), finished)]


@pytest.mark.parametrize("rule", RULES)
def test_every_frame_is_smoothed_once_and_the_last_ones_with_the_end(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    observed: list[Descriptor | None] = [*descriptors, *descriptors[::-1]]
    observed[3] = observed[11] = None
    batch = [stage.feature(header(s), descriptor) for s, descriptor in enumerate(observed)]
    stage.handle(*batch[:7])
    stage.handle(*batch[7:], stage.feature(header(len(observed), end=True)))
    for channel in stage.channels:
        assert stage.smoothed(channel) == smoothed_offline(route_map, channel, rule, observed)


def test_a_frame_that_comes_again_is_answered_by_the_same_message(
    route_map: Map, descriptors: list[Descriptor]
) -> None:
    stage = Stage(route_map, "filter")
    batch = [stage.feature(header(s), descriptor) for s, descriptor in enumerate(descriptors)]
    batch.append(stage.feature(header(len(descriptors), end=True)))
    stage.handle(*batch)
    first = stage.smoothed(0)
    stage.handle(*batch)
    assert stage.smoothed(0, first=len(batch)) == first


def test_a_malformed_message_or_one_of_another_map_leaves_the_stream_as_it_was(
    route_map: Map, descriptors: list[Descriptor]
) -> None:
    stage = Stage(route_map, "evidence")
    foreign = FeatureMessage(model="of another map", descriptor=descriptors[0])
    short = FeatureMessage(model=stage.model, descriptor=descriptors[0][:-1])
    huge = FeatureMessage(model=stage.model, descriptor=descriptors[0] * np.float32(1e20))
    refusals: list[tuple[FeatureMessage | bytes, str]] = [
        (b"\xc1", "no msgpack"),
        (b"", "no msgpack"),
        (foreign, "give the featurizer the same map"),
        (short, f"descriptor of shape .*{len(descriptors[0]) - 1},.*, not .*{len(descriptors[0])}"),
        (huge, "descriptor of length 1e\\+20, not 1"),
    ]
    for sequence, descriptor in enumerate(descriptors):
        for message, reason in refusals:
            for about in (header(sequence), header(9, stream="another"), header(2**40)):
                with pytest.raises(MessageError, match=reason):
                    stage.handle(received(Keys(RUNS[0]).feature, about, message))
        stage.send(header(sequence), descriptor)
    assert stage.candidates(0) == offline(route_map, 0, "evidence", [*descriptors])
    assert stage.counts == {RUNS[0]: {"streams": 1}, RUNS[1]: {}}


@dataclass(frozen=True)
class Sent:
    """A message to a worker: its run, its frame, and how many more are in the same batch."""

    run: str
    gap: int
    observed: bool


traffic = st.lists(
    st.lists(st.builds(Sent, st.sampled_from(RUNS), st.sampled_from([0, 0, 0, 2]), st.booleans())),
    max_size=8,
)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(traffic=traffic)
def test_runs_and_batches_change_no_bit_of_a_candidate(
    route_map: Map,
    descriptors: list[Descriptor],
    rule: Rule,
    reverse: bool,
    traffic: list[list[Sent]],
) -> None:
    stage = Stage(route_map, rule, reverse=reverse)
    pushed: dict[str, list[Descriptor | None]] = {run: [] for run in RUNS}
    answered: dict[str, list[int]] = {run: [] for run in RUNS}
    for number, batch in enumerate(traffic):
        messages = []
        for place, sent in enumerate(batch):
            of_run = pushed[sent.run]
            of_run += [None] * (sent.gap if of_run else 0)
            observed = (
                descriptors[(7 * number + place) % len(descriptors)] if sent.observed else None
            )
            about = header(len(of_run), stream=sent.run)
            messages.append(stage.feature(about, observed, run=sent.run))
            answered[sent.run].append(len(of_run))
            of_run.append(observed)
        stage.handle(*messages)
    for run in RUNS:
        alone = offline(route_map, 2, rule, pushed[run], reverse=reverse)
        assert stage.candidates(2, run=run) == [alone[sequence] for sequence in answered[run]]


def test_a_stream_that_follows_another_in_one_batch_begins_afresh(
    route_map: Map, descriptors: list[Descriptor]
) -> None:
    stage = Stage(route_map, "filter")
    first = [stage.feature(header(s), d) for s, d in enumerate(descriptors[:5])]
    second = [stage.feature(header(s, stream="next"), d) for s, d in enumerate(descriptors)]
    stage.handle(*first, stage.feature(header(5, end=True)), *second)
    expected = offline(route_map, 0, "filter", [*descriptors])
    assert stage.candidates(0) == expected[:5] + expected
    assert stage.publishers[RUNS[0]].sequences == [*range(5), 5, *range(len(descriptors))]


def test_frames_lost_to_a_defect_are_missing_observations(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = Stage(route_map, "filter")
    messages = [stage.feature(header(s), d) for s, d in enumerate(descriptors)]
    stage.handle(*messages[:4])
    with monkeypatch.context() as patch:
        patch.setattr(MetricPlaces, "compare", lambda *_: 1 // 0)
        stage.handle(*messages[4:6])
    assert stage.counts[RUNS[0]]["failed"] == 2
    stage.handle(*messages[6:])
    observed = [None if s in (4, 5) else d for s, d in enumerate(descriptors)]
    expected = offline(route_map, 0, "filter", observed)
    assert stage.candidates(0) == expected[:4] + expected[6:]


def test_a_defect_in_one_stream_costs_one_frame_and_no_other_of_the_batch(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    channels = [replace(one, metric=replace(one.metric)) for one in route_map.channels]
    stage = Stage(replace(route_map, channels=channels), "filter")
    batch = [
        stage.feature(header(sequence), descriptor, run=run)
        for sequence, descriptor in enumerate(descriptors[:8])
        for run in RUNS
    ]
    pushed, real = iter(range(1000)), FilterMatcher.local

    def local(
        self: FilterMatcher, observed: Comparison | None, odometry_m: float | None
    ) -> Partial:
        if next(pushed) == 9:  # two runs and two channels: the second channel, in the third frame
            raise ZeroDivisionError
        return real(self, observed, odometry_m)

    monkeypatch.setattr(FilterMatcher, "local", local)
    stage.handle(*batch)
    assert stage.counts[RUNS[0]]["failed"] == 1
    observed = [None if s == 2 else d for s, d in enumerate(descriptors[:8])]
    damaged = offline(route_map, 2, "filter", observed)
    assert stage.candidates(2) == damaged[:2] + damaged[3:]
    whole = offline(route_map, 0, "filter", [*descriptors[:8]])
    assert stage.candidates(0) == whole[:2] + whole[3:]
    assert "failed" not in stage.counts[RUNS[1]]
    for channel in stage.channels:
        expected = offline(route_map, channel, "filter", [*descriptors[:8]])
        assert stage.candidates(channel, run=RUNS[1]) == expected


def test_matchers_get_the_odometry_of_frames_and_none_for_frames_that_did_not_come(
    route_map: Map, descriptors: list[Descriptor], given_odometry: list[float | None]
) -> None:
    stage = Stage(route_map, "filter")
    given_odometry.clear()  # of the warm-up
    readings = {0: 3.5, 1: None, 4: 7.0, 5: 7.0}
    stage.handle(
        *(
            stage.feature(header(s), None if s == 4 else descriptors[s], odometry_m=reading)
            for s, reading in readings.items()
        )
    )
    assert given_odometry == [3.5, None, None, None, 7.0, 7.0]


@pytest.mark.parametrize("known", [True, False])
def test_matchers_get_the_metres_travelled_if_the_map_has_them(
    route_map: Map,
    descriptors: list[Descriptor],
    given_cells: list[RouteCells | None],
    known: bool,
) -> None:
    travelled = np.arange(60.0) if known else np.empty(0)
    places = replace(route_map.places, travelled=travelled)
    stage = Stage(replace(route_map, places=places), "filter")
    stage.send(header(0), descriptors[0])
    assert (given_cells[-1] is not None) == known


def test_odometry_is_fetched_with_the_frames(
    route_map: Map, descriptors: list[Descriptor], given_odometry: list[float | None]
) -> None:
    stage = Stage(route_map, "filter")
    given_odometry.clear()
    stage.remember_elsewhere(descriptors[:6], odometry_m=[0.0, 1.0, 2.0, None, 4.0, 5.0])
    stage.handle(stage.feature(header(6), descriptors[6], odometry_m=6.0))
    assert given_odometry == [0.0, 1.0, 2.0, None, 4.0, 5.0, 6.0]


def test_a_channel_that_the_map_does_not_have_is_refused(map_path: Path) -> None:
    with pytest.raises(ConfigError, match="--channel 3: the map has channels 0 to 2"):
        run_channels(MapVersions(map_path), [0, 3], Config(), threading.Event())
