import threading
from collections import Counter
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from bus_doubles import RecordingPublisher, header, received
from numpy.typing import NDArray

from placefield.bus.keys import Keys
from placefield.bus.messages import CandidateMessage, FeatureMessage, Header
from placefield.config import Config, MatchingConfig, Rule
from placefield.errors import ConfigError, MessageError
from placefield.features.descriptors import DescriptorStream
from placefield.features.extract import feature_of_model
from placefield.maps.map import Map, fingerprint
from placefield.matching.channel_matcher import matcher_of
from placefield_services.channel import ChannelWorker, run_channels

KEY = Keys("test").feature
RULES: tuple[Rule, ...] = get_args(Rule)
Descriptor = NDArray[np.float32]


@pytest.fixture(scope="module")
def descriptors(query_dir: Path, route_map: Map) -> list[Descriptor]:
    stream = DescriptorStream(route_map.model)
    feature = feature_of_model(route_map.model)
    files = sorted(query_dir.iterdir())[:20]
    return [stream.push(feature.describe(file.read_bytes())) for file in files]


class Stage:
    """A channel worker, what it published and what it counted."""

    def __init__(
        self,
        placemap: Map,
        rule: Rule,
        channels: tuple[int, ...] = (0, 2),
        *,
        reverse: bool = False,
    ) -> None:
        self.model = fingerprint(placemap.model)
        self.publishers = {channel: RecordingPublisher() for channel in channels}
        self.counts: Counter[str] = Counter()
        matching = MatchingConfig(rule=rule, reverse=reverse)
        self._worker = ChannelWorker(placemap, self.publishers, matching, self.counts)

    def handle(self, about: Header, message: FeatureMessage | bytes = b"") -> None:
        self._worker.handle(received(KEY, about, message))

    def send(self, about: Header, descriptor: Descriptor | None) -> None:
        self.handle(about, FeatureMessage(model=self.model, descriptor=descriptor))

    def candidates(self, channel: int) -> list[tuple[int, int, float, bytes]]:
        """Sequence, place, score and evidence of what was published."""
        return [
            (about.sequence, message.place, message.score, message.evidence.tobytes())
            for about, message in self.publishers[channel].sent
            if isinstance(message, CandidateMessage)
        ]


def offline(
    placemap: Map, channel: int, rule: Rule, descriptors: list[Descriptor | None]
) -> list[tuple[int, int, float, bytes]]:
    matcher = matcher_of(placemap.channels[channel], rule)
    candidates = [matcher.push(descriptor) for descriptor in descriptors]
    return [(s, c.place, c.score, c.evidence.tobytes()) for s, c in enumerate(candidates)]


@pytest.mark.parametrize("rule", RULES)
def test_each_channel_answers_each_frame_as_its_matcher_does(
    route_map: Map, descriptors: list[Descriptor], rule: Rule
) -> None:
    stage = Stage(route_map, rule)
    for sequence, descriptor in enumerate(descriptors):
        stage.send(header(sequence), descriptor)
    for channel, publisher in stage.publishers.items():
        assert stage.candidates(channel) == offline(route_map, channel, rule, [*descriptors])
        for _, message in publisher.sent:
            assert isinstance(message, CandidateMessage)
            assert (message.channel, message.rule) == (channel, rule)
    assert any(place >= 0 for _, place, _, _ in stage.candidates(0))


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
    assert stage.counts["gaps"] == len(missing)


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


def test_the_end_of_the_stream_is_passed_on_by_every_channel(route_map: Map) -> None:
    stage = Stage(route_map, "evidence")
    stage.handle(header(0, end=True))
    for publisher in stage.publishers.values():
        assert publisher.sent == [(header(0, end=True), None)]


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
        (short, f"descriptor of {len(descriptors[0]) - 1}, not {len(descriptors[0])} values"),
        (huge, "descriptor of length 1e\\+20, not 1"),
    ]
    for sequence, descriptor in enumerate(descriptors):
        for message, reason in refusals:
            for about in (header(sequence), header(9, stream="another"), header(2**40)):
                with pytest.raises(MessageError, match=reason):
                    stage.handle(about, message)
        stage.send(header(sequence), descriptor)
    assert stage.candidates(0) == offline(route_map, 0, "evidence", [*descriptors])
    assert stage.counts == {"streams": 1, "gaps": 0}


def test_a_channel_that_the_map_has_not_is_refused(route_map: Map) -> None:
    with pytest.raises(ConfigError, match="--channel 3: the map has channels 0 to 2"):
        run_channels(route_map, [0, 3], Config(), threading.Event())
