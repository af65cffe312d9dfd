from collections import Counter
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from bus_doubles import PeerCache, RecordingPublisher, at_last, header, received
from lenses import Lens
from numpy.typing import NDArray

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import (
    FeatureMessage,
    FrameMessage,
    MissingObservationMessage,
    MomentsMessage,
    RawFeatureMessage,
)
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.errors import MessageError
from placefield.features.calibration import Calibration
from placefield.features.descriptor_stage import DescriptorStage
from placefield.features.descriptors import DescriptorStream
from placefield.features.extract import feature_of, feature_of_model
from placefield.features.fitting import fit_descriptors
from placefield.features.frames import Frame
from placefield.features.joined_model import JoinedModel
from placefield.features.rectification import view_of
from placefield.maps.map import Map, fingerprint
from placefield_services import featurizer as featurizer_module
from placefield_services.featurizer import Featurizer
from placefield_services.featurizer_outputs import FeaturizerOutputs
from placefield_services.live_describers import LiveDescribers
from placefield_services.raw_features import RawFeatures, RawKind

KEY = Keys("test").frame


@pytest.fixture(autouse=True)
def ask_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(featurizer_module, "_ASK_EVERY_S", 0.0)
    monkeypatch.setattr(featurizer_module, "_ASK_FOR_S", 0.0)


@pytest.fixture
def images(query_dir: Path) -> list[bytes]:
    return [file.read_bytes() for file in sorted(query_dir.iterdir())[:6]]


def calibrated(placemap: Map) -> tuple[Map, Calibration]:
    """Return a map with the view of a camera with distortion, and the calibration."""
    lens = Lens("fisheye", (0.02, 0.0, 0.0, 0.0), 96, 72, (78.0, 78.0), (47.5, 35.5))
    model = replace(placemap.model, view=view_of(lens.calibration))
    return replace(placemap, model=model), lens.calibration


class Stage:
    """A featurizer with its published messages and its counts."""

    def __init__(self, placemap: Map) -> None:
        self.publisher = RecordingPublisher(FeatureMessage)
        self.moments = RecordingPublisher(MomentsMessage)
        self.unobserved = RecordingPublisher(MissingObservationMessage)
        self.features_elsewhere, self.moments_elsewhere = PeerCache(), PeerCache()
        self.counts: Counter[str] = Counter()
        self.model = fingerprint(placemap.model)
        kind = RawKind(self.model, tuple(part.raw_dimensions for part in placemap.model.parts))
        self.raws = RawFeatures(LiveDescribers(), kind, 1.0, self.counts)
        outputs = FeaturizerOutputs(
            CachedPublisher(self.publisher, ReplayCache()),
            CachedPublisher(self.moments, ReplayCache()),
            self.unobserved,
            self.features_elsewhere.fetch,
            self.moments_elsewhere.fetch,
            self.raws,
        )
        other = FeaturizerOutputs(
            CachedPublisher(RecordingPublisher(FeatureMessage), ReplayCache()),
            CachedPublisher(RecordingPublisher(MomentsMessage), ReplayCache()),
            RecordingPublisher(MissingObservationMessage),
            PeerCache().fetch,
            PeerCache().fetch,
            RawFeatures(LiveDescribers(), kind, 1.0, Counter()),
        )
        self._featurizer = Featurizer(
            DescriptorStage(placemap.model),
            self.model,
            {"test": outputs, "other": other},
            {"test": self.counts, "other": Counter()},
        )

    def handle(self, message: Received) -> None:
        at_last(lambda: self._featurizer.handle(message))

    def send(self, about: Header, image: bytes, odometry_m: float | None = None) -> None:
        self.handle(received(KEY, about, FrameMessage(image=image, odometry_m=odometry_m)))

    def send_raw(self, sequence: int, part: int, raw: NDArray[np.float32]) -> None:
        """Let a describer send a raw feature."""
        message = RawFeatureMessage(model=self.model, part=part, raw=raw)
        self.raws.receive(received(Keys("test").raw("a"), header(sequence), message), str)

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
        expected = offline.update(feature.describe(image))
        assert np.array_equal(message.descriptor, expected)


def test_the_raw_feature_of_a_describer_gives_the_same_descriptor_as_the_image(
    stage: Stage, route_map: Map, images: list[bytes]
) -> None:
    alone = Stage(route_map)
    for sequence, image in enumerate(images):
        is_described = sequence in (1, 2, 4)
        if is_described:
            stage.send_raw(sequence, 0, feature_of_model(route_map.model).describe(image))
        stage.send(header(sequence), b"not looked at" if is_described else image)
        alone.send(header(sequence), image)
    assert stage.descriptors == alone.descriptors


def test_parts_of_describers_in_any_number_give_the_same_descriptor_as_the_image(
    route_map: Map, images: list[bytes]
) -> None:
    grey = fit_descriptors(
        [np.stack([feature_of("grayscale").describe(image) for image in images])],
        "grayscale",
        dimensions=3,
        standardise=True,
        plain=False,
    )[0]
    joined = replace(route_map, model=JoinedModel((route_map.model, grey)))
    stage, alone = Stage(joined), Stage(joined)
    described: list[tuple[str, ...]] = [(), ("gist",), ("grayscale",), ("grayscale", "gist")]
    for sequence, (image, kinds) in enumerate(zip(images, described, strict=False)):
        for kind in kinds:
            raw = feature_of(kind).describe(image)
            stage.send_raw(sequence, ("gist", "grayscale").index(kind), raw)
        stage.send(header(sequence), b"not looked at" if len(kinds) == 2 else image)
        alone.send(header(sequence), image)
    assert stage.descriptors == alone.descriptors
    assert None not in stage.descriptors


@pytest.fixture
def descriptor_map(route_map: Map) -> Map:
    """The same map, as if its features had been given as descriptors."""
    return replace(route_map, model=replace(route_map.model, kind="descriptor"))


def test_a_given_descriptor_is_standardised_and_reduced_like_the_feature_of_an_image(
    descriptor_map: Map, images: list[bytes]
) -> None:
    stage, offline = Stage(descriptor_map), DescriptorStream(descriptor_map.model)
    for sequence, image in enumerate(images):
        given = feature_of("gist").describe(image).astype([np.float16, np.float32][sequence % 2])
        message = FrameMessage(descriptor=given, odometry_m=sequence)
        stage.handle(received(KEY, header(sequence), message))
        expected = offline.update(given.astype(np.float32))
        assert expected is not None
        assert stage.descriptors[-1] == expected.tobytes()
    assert not stage.unobserved.sent


def test_a_frame_of_a_calibrated_camera_has_the_descriptor_that_the_library_gives(
    route_map: Map, images: list[bytes]
) -> None:
    of_view, calibration = calibrated(route_map)
    stage, plain = Stage(of_view), Stage(route_map)
    offline = DescriptorStage(of_view.model).new_stream()
    for sequence, image in enumerate(images):
        message = FrameMessage(image=image, calibration=calibration)
        stage.handle(received(KEY, header(sequence), message))
        plain.send(header(sequence), image)
        frame = Frame(sequence, 0, "", image, calibration=calibration)
        expected = offline.update_frame(frame)
        assert expected is not None
        assert stage.descriptors[-1] == expected.tobytes()
    assert stage.descriptors != plain.descriptors
    stage.send(header(len(images)), images[0])
    plain.handle(received(KEY, header(len(images)), message))
    assert (stage.counts["unreadable"], plain.counts["unreadable"]) == (1, 1)


def test_a_frame_that_the_map_does_not_take_is_a_missing_observation(
    descriptor_map: Map, route_map: Map, images: list[bytes], caplog: pytest.LogCaptureFixture
) -> None:
    of_descriptors, of_images = Stage(descriptor_map), Stage(route_map)
    of_descriptors.send(header(0), images[0])
    narrow = FrameMessage(descriptor=np.ones(9, np.float32))
    of_descriptors.handle(received(KEY, header(1), narrow))
    given = FrameMessage(descriptor=feature_of("gist").describe(images[0]))
    of_images.handle(received(KEY, header(0), given))
    assert of_descriptors.descriptors == [None, None]
    assert of_images.descriptors == [None]
    assert (of_descriptors.counts["unreadable"], of_images.counts["unreadable"]) == (2, 1)
    assert "an image, but the map is of descriptors: give a descriptor" in caplog.text
    assert "a descriptor, but gist describes images: give an image" in caplog.text


def test_odometry_is_passed_on_with_every_frame_observed_or_not(
    stage: Stage, images: list[bytes]
) -> None:
    blank = cv2.imencode(".png", np.full((48, 64), 99, np.uint8))[1].tobytes()
    readings = [0.0, 1.5, 1.5, None, 2.0]
    for sequence, image in enumerate([images[0], b"no image", blank, images[1], images[2]]):
        stage.send(header(sequence), image, readings[sequence])
    assert [message.odometry_m for message in stage.features if message] == readings
    assert [descriptor is None for descriptor in stage.descriptors] == [0, 1, 1, 0, 0]
    assert (stage.counts["unreadable"], stage.counts["blank"]) == (1, 1)
    sent = [(about.sequence, message) for about, message in stage.unobserved.sent]
    assert sent == [
        (1, MissingObservationMessage(reason="unreadable")),
        (2, MissingObservationMessage(reason="blank")),
    ]


@pytest.mark.parametrize("broken", [b"", b"no image", b"\xff\xd8\xff\xe0", b"\x89PNG\r\n\x1a\n"])
def test_an_unreadable_frame_has_no_descriptor_and_affects_no_other(
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


def test_only_the_first_unreadable_frame_of_a_stream_is_logged(
    stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    for stream in ("first", "second"):
        for sequence in range(3):
            stage.send(header(sequence, stream=stream), b"no image")
    logged = [message for message in caplog.messages if "missing observation" in message]
    assert [message[:8] for message in logged] == ["frame 0 ", "frame 0 "]


def test_a_blank_image_has_no_descriptor_and_is_counted(stage: Stage, images: list[bytes]) -> None:
    even = cv2.imencode(".png", np.full((48, 64), 99, np.uint8))[1].tobytes()
    for sequence, image in enumerate([images[0], even, images[1]]):
        stage.send(header(sequence), image)
    assert [one is None for one in stage.descriptors] == [False, True, False]
    assert stage.counts["blank"] == 1


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


def test_a_frame_that_comes_again_is_not_described_but_answered_again(
    stage: Stage, images: list[bytes]
) -> None:
    for sequence in (0, 1, 1, 0, 2):
        stage.send(header(sequence), images[sequence])
    stage.send(header(0, stream="next"), images[0])
    stage.send(header(3), images[3])
    assert stage.publisher.sequences == [0, 1, 1, 0, 2, 0]
    assert stage.descriptors[1] == stage.descriptors[2]
    assert stage.descriptors[0] == stage.descriptors[3] == stage.descriptors[5]
    assert stage.counts["repeated"] == 2
    assert stage.counts["stale"] == 1


def test_a_live_frame_that_comes_again_is_dropped(stage: Stage, images: list[bytes]) -> None:
    for sequence in (0, 1, 1, 0, 2):
        stage.send(header(sequence, live=True), images[sequence])
    assert stage.publisher.sequences == [0, 1, 2]


def test_a_lossless_frame_waits_for_those_before_it_to_be_sent_again(
    stage: Stage, route_map: Map, images: list[bytes]
) -> None:
    whole = Stage(route_map)
    for sequence in range(4):
        whole.send(header(sequence), images[sequence])
    for sequence in (0, 2, 3, 1, 2, 3):
        stage.send(header(sequence), images[sequence])
    assert stage.publisher.sequences == [0, 1, 2, 3]
    assert stage.descriptors == whole.descriptors
    assert stage.counts["out_of_order"] == 2


def test_a_live_frame_waits_for_none(stage: Stage, images: list[bytes]) -> None:
    for sequence in (0, 2, 1, 3):
        stage.send(header(sequence, live=True), images[sequence])
    assert stage.publisher.sequences == [0, 2, 3]
    assert stage.counts["gaps"] == 1


def ended_in_the_midst(route_map: Map, images: list[bytes], *, live: bool) -> tuple[Stage, Stage]:
    """Return a featurizer of all frames, and one that resumes the stream after the first frames."""
    whole, second = Stage(route_map), Stage(route_map)
    for sequence, image in enumerate(images):
        whole.send(header(sequence, live=live), image)
    for kept, published in (
        (second.features_elsewhere, whole.publisher),
        (second.moments_elsewhere, whole.moments),
    ):
        for about, message in published.sent[:3]:
            assert message is not None
            kept.kept[about.sequence] = about, message.encode()
    return whole, second


@pytest.mark.parametrize("live", [False, True])
def test_a_restarted_featurizer_resumes_a_stream_with_the_same_descriptors(
    route_map: Map, images: list[bytes], live: bool
) -> None:
    whole, second = ended_in_the_midst(route_map, images, live=live)
    for sequence in range(3, len(images)):
        second.send(header(sequence, live=live, oldest=0 if live else 2), images[sequence])
    assert second.descriptors == whole.descriptors[3:]


def test_a_restarted_featurizer_resumes_a_lossless_stream_where_it_ended(
    route_map: Map, images: list[bytes]
) -> None:
    whole, second = ended_in_the_midst(route_map, images, live=False)
    for sequence in (4, 1, 2, 3, 4, 5):  # the first was under way, the source sends all again
        second.send(header(sequence, oldest=1), images[sequence])
    assert second.publisher.sequences == [1, 2, 3, 4, 5]
    assert second.descriptors == whole.descriptors[1:]


def test_a_stream_in_no_cache_is_resumed_from_the_oldest_awaited_frame(
    stage: Stage, images: list[bytes]
) -> None:
    for sequence in (3, 2, 3):
        stage.send(header(sequence, oldest=2), images[sequence])
    assert stage.publisher.sequences == [2, 3]


@pytest.mark.parametrize("live", [False, True])
def test_if_too_little_is_cached_every_later_frame_of_the_stream_is_marked_as_forgotten(
    route_map: Map, images: list[bytes], live: bool
) -> None:
    _, knows = ended_in_the_midst(route_map, images, live=live)
    forgot = Stage(route_map)
    for stage in (knows, forgot):
        for sequence in (3, 4):
            stage.send(header(sequence, live=live, oldest=0 if live else 3), images[sequence])
        stage.send(header(0, stream="next", live=live), images[0])
    flags = [
        [feature.forgotten for feature in each.features if feature] for each in (knows, forgot)
    ]
    assert flags == [[False, False, False], [True, True, False]]


def test_the_end_of_the_stream_is_passed_on_after_the_last_frame(
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
