from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from bus_doubles import RecordingPublisher, header, received

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.messages import FeatureMessage, FrameMessage, Header
from placefield.errors import MessageError
from placefield.features.descriptors import DescriptorStream
from placefield.features.extract import feature_of_model
from placefield.maps.map import Map, fingerprint
from placefield_services.featurizer import Featurizer

KEY = Keys("test").frame


@pytest.fixture
def images(query_dir: Path) -> list[bytes]:
    return [file.read_bytes() for file in sorted(query_dir.iterdir())[:6]]


class Stage:
    """A featurizer, what it published and what it counted."""

    def __init__(self, placemap: Map) -> None:
        self.publisher = RecordingPublisher()
        self.counts: Counter[str] = Counter()
        self._featurizer = Featurizer(
            placemap.model,
            {"test": self.publisher, "other": RecordingPublisher()},
            {"test": self.counts, "other": Counter()},
        )
        self._featurizer.rehearse()

    def handle(self, message: Received) -> None:
        self._featurizer.handle(message)

    def send(self, about: Header, image: bytes) -> None:
        self.handle(received(KEY, about, FrameMessage(image=image)))

    @property
    def features(self) -> list[FeatureMessage | None]:
        return [
            None if feature is None else FeatureMessage.decode(feature.encode())
            for _, feature in self.publisher.sent
        ]

    @property
    def descriptors(self) -> list[bytes | None]:
        return [
            None if feature is None or feature.descriptor is None else feature.descriptor.tobytes()
            for feature in self.features
        ]


@pytest.fixture
def stage(route_map: Map) -> Stage:
    return Stage(route_map)


def test_each_frame_becomes_its_descriptor(
    stage: Stage, route_map: Map, images: list[bytes]
) -> None:
    offline = DescriptorStream(route_map.model)
    feature = feature_of_model(route_map.model)
    for sequence, image in enumerate(images):
        stage.send(header(sequence), image)
    assert [about for about, _ in stage.publisher.sent] == [header(s) for s in range(len(images))]
    for message, image in zip(stage.features, images, strict=True):
        assert message is not None
        assert message.descriptor is not None
        assert message.model == fingerprint(route_map.model)
        expected = offline.push(feature.describe(image))
        assert np.array_equal(message.descriptor, expected)


@pytest.mark.parametrize("broken", [b"", b"no image", b"\xff\xd8\xff\xe0", b"\x89PNG\r\n\x1a\n"])
def test_an_unreadable_frame_goes_on_without_a_descriptor_and_touches_no_other(
    route_map: Map, images: list[bytes], broken: bytes
) -> None:
    whole, damaged = Stage(route_map), Stage(route_map)
    for sequence, image in enumerate([*images[:3], broken, *images[3:]]):
        damaged.send(header(sequence), image)
    for sequence, image in enumerate(images):
        whole.send(header(sequence), image)
    assert damaged.counts["unreadable"] == 1
    assert damaged.publisher.sequences == list(range(len(images) + 1))
    assert damaged.descriptors[3] is None
    assert damaged.descriptors[:3] + damaged.descriptors[4:] == whole.descriptors


def test_pixels_are_as_good_as_a_file_and_odd_ones_are_unreadable(stage: Stage) -> None:
    shapes = [(48, 64), (48, 64, 3), (48, 64, 4), (1, 1)]
    for sequence, shape in enumerate(shapes):
        pixels = np.random.default_rng(1).integers(0, 256, shape, np.uint8)
        stage.handle(received(KEY, header(sequence), FrameMessage(image=pixels)))
    described = [descriptor is not None for descriptor in stage.descriptors]
    assert described[:3] == [True, True, False]
    assert len(described) == len(shapes)


def test_a_new_stream_begins_afresh(stage: Stage, images: list[bytes]) -> None:
    for stream in ("first", "second"):
        for sequence, image in enumerate(images):
            stage.send(header(sequence, stream=stream), image)
    assert stage.descriptors[: len(images)] == stage.descriptors[len(images) :]
    assert stage.counts["streams"] == 2


def test_frames_that_came_twice_or_too_late_are_not_described_again(
    stage: Stage, images: list[bytes]
) -> None:
    for sequence in (0, 1, 1, 0, 2):
        stage.send(header(sequence), images[sequence])
    stage.send(header(0, stream="next"), images[0])
    stage.send(header(3), images[3])
    assert stage.publisher.sequences == [0, 1, 2, 0]
    assert stage.counts["duplicate"] == 2
    assert stage.counts["stale"] == 1


def test_the_end_of_the_stream_is_passed_on_behind_the_last_frame(
    stage: Stage, images: list[bytes]
) -> None:
    stage.send(header(0), images[0])
    stage.handle(received(KEY, header(1, end=True)))
    assert stage.publisher.sent[-1] == (header(1, end=True), None)


@pytest.mark.parametrize("stream", ["s", "another"])
@pytest.mark.parametrize("sequence", [0, 1, 2**40])
@pytest.mark.parametrize("garbage", [b"", b"\xc1", FeatureMessage(model="m", descriptor=None)])
def test_garbage_under_a_good_header_leaves_the_stream_as_it_was(
    route_map: Map,
    images: list[bytes],
    stream: str,
    sequence: int,
    garbage: bytes | FeatureMessage,
) -> None:
    clean, disturbed = Stage(route_map), Stage(route_map)
    for number, image in enumerate(images[:3]):
        clean.send(header(number), image)
        disturbed.send(header(number), image)
        with pytest.raises(MessageError):
            disturbed.handle(received(KEY, header(sequence, stream=stream), garbage))
    assert disturbed.descriptors == clean.descriptors
    assert disturbed.counts == clean.counts


def test_another_run_changes_no_bit_of_a_descriptor(route_map: Map, images: list[bytes]) -> None:
    alone, shared = Stage(route_map), Stage(route_map)
    wanted = [*images[:3], b"no image", *images[3:]]
    for sequence, image in enumerate(wanted):
        alone.send(header(sequence), image)
        shared.send(header(sequence), image)
        other = FrameMessage(image=wanted[-1 - sequence])
        shared.handle(received(Keys("other").frame, header(sequence, stream="other"), other))
    assert shared.publisher.sequences == list(range(len(wanted)))
    assert shared.descriptors == alone.descriptors
    assert shared.counts == alone.counts
