import threading
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from bus_doubles import Memory, RecordingPublisher, header, received
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.bus.history import History, Outbox
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.messages import BordersMessage, CandidatesMessage, FeatureMessage, Header
from placefield.config import Config, MatchingConfig, Rule
from placefield.errors import ConfigError, MessageError
from placefield.features.descriptors import DescriptorStream
from placefield.features.extract import feature_of_model
from placefield.maps.map import Map, fingerprint
from placefield.matching.candidate import Candidate
from placefield.matching.channel_matcher import FilterMatcher, matcher_of
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield_services import channel as channel_module
from placefield_services.channel import ChannelWorker, run_channels
from placefield_services.channel_streams import Outlet
from placefield_services.served_channels import WholeChannels

RUNS = ("day", "night")


@pytest.fixture(autouse=True)
def ask_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a worker not wait for what nobody remembers."""
    monkeypatch.setattr(channel_module, "_ASK_FOR_S", 0.0)


RULES: tuple[Rule, ...] = get_args(Rule)
Descriptor = NDArray[np.float32]
Told = tuple[int, int, float, bytes, bytes]
"""Sequence, place, score, places and evidence of a candidate."""


@pytest.fixture(scope="module")
def descriptors(query_dir: Path, route_map: Map) -> list[Descriptor]:
    stream = DescriptorStream(route_map.model)
    feature = feature_of_model(route_map.model)
    files = sorted(query_dir.iterdir())[:20]
    return [stream.push(feature.describe(file.read_bytes())) for file in files]


class Stage:
    """A channel worker of two runs, what it published and what it counted."""

    def __init__(
        self,
        placemap: Map,
        rule: Rule,
        channels: tuple[int, ...] = (0, 2),
        *,
        reverse: bool = False,
    ) -> None:
        self.model = fingerprint(placemap.model)
        self.channels = channels
        self.publishers = {run: RecordingPublisher(CandidatesMessage) for run in RUNS}
        self.elsewhere = {run: Memory() for run in RUNS}
        self.counts: dict[str, Counter[str]] = {run: Counter() for run in RUNS}
        matching = MatchingConfig(rule=rule, reverse=reverse)
        outlets = {run: self._outlet(run) for run in RUNS}
        served = WholeChannels(placemap, channels, matching)
        served.rehearse()
        self._worker = ChannelWorker(placemap.model, served, outlets, self.counts)

    def _outlet(self, run: str) -> Outlet:
        return Outlet(
            candidates=Outbox(self.publishers[run], History()),
            recall=self.elsewhere[run].recall,
            borders=Outbox(RecordingPublisher(BordersMessage), History()),
            recall_borders=lambda *_: [],
        )

    def feature(
        self, about: Header, descriptor: Descriptor | None = None, *, run: str = RUNS[0]
    ) -> Received:
        message = FeatureMessage(model=self.model, descriptor=descriptor)
        return received(Keys(run).feature, about, b"" if about.end else message)

    def remember_elsewhere(self, descriptors: list[Descriptor], *, live: bool = False) -> None:
        """Let another service remember all of a stream."""
        for sequence, descriptor in enumerate(descriptors):
            message = FeatureMessage(model=self.model, descriptor=descriptor)
            self.elsewhere[RUNS[0]].kept[sequence] = header(sequence, live=live), message.encode()

    def handle(self, *batch: Received) -> None:
        self._worker.match([self._worker.accept(message) for message in batch])

    def send(self, about: Header, descriptor: Descriptor | None) -> None:
        self.handle(self.feature(about, descriptor))

    def candidates(self, channel: int, *, run: str = RUNS[0]) -> list[Told]:
        """What was published of a channel."""
        return [
            (about.sequence, each.place, each.score, each.places.tobytes(), each.evidence.tobytes())
            for about, message in self.publishers[run].sent
            if isinstance(message, CandidatesMessage)
            for each in message.candidates
            if each.channel == channel
        ]


def offline(
    placemap: Map,
    channel: int,
    rule: Rule,
    descriptors: list[Descriptor | None],
    *,
    reverse: bool = False,
) -> list[Told]:
    matcher = matcher_of(placemap.channels[channel], rule, reverse=reverse)
    places = MetricPlaces(placemap.channels[channel].metric, exact=False)
    candidates = [
        matcher.push(None if descriptor is None else next(iter(places.compare(descriptor[None]))))
        for descriptor in descriptors
    ]
    return [
        (s, c.place, c.score, c.places.tobytes(), c.evidence.tobytes())
        for s, c in enumerate(candidates)
    ]


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
def test_frames_that_did_not_come_are_matched_as_frames_not_seen(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    missing = {4, 5, 6, 11}
    for sequence, descriptor in enumerate(descriptors):
        if sequence not in missing:
            stage.send(header(sequence), descriptor)
    seen = [None if s in missing else descriptor for s, descriptor in enumerate(descriptors)]
    expected = [c for c in offline(route_map, 0, rule, seen) if c[0] not in missing]
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
    seen: list[Descriptor | None] = [*descriptors]
    seen[0] = seen[7] = None
    for sequence, descriptor in enumerate(seen):
        stage.send(header(sequence), descriptor)
    assert stage.candidates(2) == offline(route_map, 2, rule, seen)


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("rule", RULES)
def test_one_that_comes_back_answers_as_if_it_had_never_been_away(
    route_map: Map, descriptors: list[Descriptor], rule: Rule, live: bool
) -> None:
    stage = Stage(route_map, rule)
    stage.remember_elsewhere(descriptors, live=live)
    for sequence in range(12, len(descriptors)):
        stage.send(header(sequence, live=live, oldest=0 if live else 10), descriptors[sequence])
    awaited = 12 if live else 10
    assert stage.candidates(0) == offline(route_map, 0, rule, [*descriptors])[awaited:]
    assert stage.counts[RUNS[0]]["gaps"] == 0


@pytest.mark.parametrize("rule", RULES)
def test_a_lossless_frame_that_was_missed_is_looked_for_elsewhere(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    stage.remember_elsewhere(descriptors)
    for sequence, descriptor in enumerate(descriptors):
        if sequence not in (4, 5, 11):
            stage.send(header(sequence), descriptor)
    assert stage.candidates(0) == offline(route_map, 0, rule, [*descriptors])
    assert stage.counts[RUNS[0]]["gaps"] == 0
    assert stage.counts[RUNS[0]]["recalled"] == 3


def test_what_may_still_be_found_is_waited_for(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(channel_module, "_ASK_FOR_S", 1000.0)
    stage = Stage(route_map, "filter")
    for sequence in (0, 1, 4, 5):
        stage.send(header(sequence), descriptors[sequence])
    assert stage.publishers[RUNS[0]].sequences == [0, 1]
    assert stage.counts[RUNS[0]]["early"] == 2
    stage.remember_elsewhere(descriptors)
    stage.send(header(6), descriptors[6])
    assert stage.candidates(0) == offline(route_map, 0, "filter", [*descriptors[:7]])


def test_a_frame_that_comes_again_is_answered_again_and_matched_once(
    route_map: Map, descriptors: list[Descriptor]
) -> None:
    stage = Stage(route_map, "filter")
    for sequence in (0, 1, 2, 1, 2, 3):
        stage.send(header(sequence), descriptors[sequence])
    told = offline(route_map, 0, "filter", [*descriptors])
    assert stage.candidates(0) == [*told[:3], *told[1:4]]


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
    assert stage.publishers[RUNS[0]].sent == [(header(0, end=True), None)]


def test_what_does_not_parse_or_is_of_another_map_leaves_the_stream_as_it_was(
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
    """What is sent to a worker: a run, a frame of its stream, and how many more in one batch."""

    run: str
    gap: int
    seen: bool


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
            seen = descriptors[(7 * number + place) % len(descriptors)] if sent.seen else None
            about = header(len(of_run), stream=sent.run)
            messages.append(stage.feature(about, seen, run=sent.run))
            answered[sent.run].append(len(of_run))
            of_run.append(seen)
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


def test_frames_that_a_defect_cost_are_matched_as_frames_not_seen(
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
    seen = [None if s in (4, 5) else d for s, d in enumerate(descriptors)]
    expected = offline(route_map, 0, "filter", seen)
    assert stage.candidates(0) == expected[:4] + expected[6:]


def test_a_defect_in_one_stream_costs_one_frame_and_no_other_of_the_batch(
    route_map: Map, descriptors: list[Descriptor], monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = Stage(route_map, "filter")
    batch = [
        stage.feature(header(sequence), descriptor, run=run)
        for sequence, descriptor in enumerate(descriptors[:8])
        for run in RUNS
    ]
    pushed, real = iter(range(1000)), FilterMatcher.push

    def push(self: FilterMatcher, seen: Comparison | None) -> Candidate:
        if next(pushed) == 9:  # two runs and two channels: the second channel, in the third frame
            raise ZeroDivisionError
        return real(self, seen)

    monkeypatch.setattr(FilterMatcher, "push", push)
    stage.handle(*batch)
    assert stage.counts[RUNS[0]]["failed"] == 1
    seen = [None if s == 2 else d for s, d in enumerate(descriptors[:8])]
    damaged = offline(route_map, 2, "filter", seen)
    assert stage.candidates(2) == damaged[:2] + damaged[3:]
    whole = offline(route_map, 0, "filter", [*descriptors[:8]])
    assert stage.candidates(0) == whole[:2] + whole[3:]
    assert "failed" not in stage.counts[RUNS[1]]
    for channel in stage.channels:
        expected = offline(route_map, channel, "filter", [*descriptors[:8]])
        assert stage.candidates(channel, run=RUNS[1]) == expected


def test_a_channel_that_the_map_has_not_is_refused(route_map: Map) -> None:
    with pytest.raises(ConfigError, match="--channel 3: the map has channels 0 to 2"):
        run_channels(route_map, [0, 3], Config(), threading.Event())
