import threading
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bus_doubles import RecordingPublisher, header, received
from lenses import Lens
from numpy.typing import NDArray

from placefield.bus.inbox import Inbox
from placefield.bus.keys import Keys
from placefield.bus.messages import FrameMessage, RawFeatureMessage
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.config import Config
from placefield.errors import ConfigError, MessageError
from placefield.features.extract import DescribingPart, Feature, feature_of, feature_of_model
from placefield.features.frames import Frame
from placefield.features.rectification import view_of
from placefield.maps.map import Map
from placefield_services.describer import (
    FrameDescriber,
    OwnParts,
    ReceivedParts,
    run_describer,
)
from placefield_services.live_describers import LiveDescribers

KEY = Keys("test").frame


class Stage:
    """A describer with its published messages and its counts."""

    def __init__(self, feature: Feature, parts: Sequence[int] = (0,)) -> None:
        self.publisher = RecordingPublisher(RawFeatureMessage)
        self.counts: Counter[str] = Counter()
        outputs = {"test": {each: CachedPublisher(self.publisher, ReplayCache()) for each in parts}}
        self.describer = FrameDescriber(feature, "model", outputs, {"test": self.counts})

    def send(self, sequence: int, frame: FrameMessage | bytes, parts: Sequence[int] = (0,)) -> None:
        come = received(KEY, header(sequence), frame)
        self.describer.handle(ReceivedParts(come.key, come.header, come.payload, parts))

    @property
    def sent(self) -> list[tuple[int, bytes | None]]:
        """Part and raw feature of each message."""
        messages = [message for _, message in self.publisher.sent]
        assert all(isinstance(one, RawFeatureMessage) and one.model == "model" for one in messages)
        return [
            (one.part, None if one.raw is None else one.raw.tobytes())
            for one in messages
            if isinstance(one, RawFeatureMessage)
        ]

    @property
    def raws(self) -> list[bytes | None]:
        return [raw for _, raw in self.sent]


@pytest.fixture
def image(query_dir: Path) -> bytes:
    return min(query_dir.iterdir()).read_bytes()


@pytest.fixture
def stage(route_map: Map) -> Stage:
    return Stage(feature_of_model(route_map.model))


def test_the_raw_feature_of_a_frame_is_published_with_its_header(
    stage: Stage, route_map: Map, image: bytes
) -> None:
    stage.send(7, FrameMessage(image=image))
    assert stage.publisher.sent[0][0] == header(7)
    assert stage.raws == [feature_of_model(route_map.model).describe(image).tobytes()]


def test_a_frame_of_a_calibrated_camera_is_rectified_first(route_map: Map, image: bytes) -> None:
    calibration = Lens(
        "fisheye", (0.02, 0.0, 0.0, 0.0), 96, 72, (78.0, 78.0), (47.5, 35.5)
    ).calibration
    model = replace(route_map.model, view=view_of(calibration))
    feature, stage = feature_of_model(model), Stage(feature_of_model(model))
    stage.send(7, FrameMessage(image=image, calibration=calibration))
    expected = feature.of_frame(Frame(7, 0, "", image, calibration=calibration))
    assert stage.raws == [expected.tobytes()]


def test_a_frame_that_comes_again_is_not_described_again(stage: Stage, image: bytes) -> None:
    for frame in (image, b"not looked at"):
        stage.send(7, FrameMessage(image=frame))
    assert stage.raws[0] == stage.raws[1]
    assert stage.counts == {"repeated": 1}


def test_each_part_of_a_frame_is_published_as_if_it_were_the_only_one(image: bytes) -> None:
    stage = Stage(feature_of("gist+grayscale"), (0, 1))
    stage.send(7, FrameMessage(image=image), (1,))
    stage.send(8, FrameMessage(image=image), (0, 1))
    gist, grey = (feature_of(kind).describe(image).tobytes() for kind in ("gist", "grayscale"))
    assert stage.sent == [(1, grey), (0, gist), (1, grey)]
    stage.send(7, FrameMessage(image=image), (0, 1))
    assert sorted(stage.sent[3:]) == [(0, gist), (1, grey)]
    assert not stage.counts


def test_a_describer_that_is_bound_to_a_part_needs_no_other(image: bytes) -> None:
    stage = Stage(feature_of("grayscale"), (1,))
    stage.send(7, FrameMessage(image=image), (1,))
    assert stage.sent == [(1, feature_of("grayscale").describe(image).tobytes())]


def test_a_describer_takes_a_frame_with_those_of_its_parts_whose_turn_it_is() -> None:
    live = LiveDescribers()
    for identity in ("a", "b", "1-c"):
        live.change(Keys("test").alive("describer", identity), True)
    inboxes = {"a": Inbox({"test": Counter()}), "c": Inbox({"test": Counter()})}
    for sequence, end in ((0, False), (1, False), (2, False), (3, True)):
        frame = received(KEY, header(sequence, end=end))
        OwnParts(live, "a", range(3)).offer(inboxes["a"], frame)
        OwnParts(live, "c", (1,)).offer(inboxes["c"], frame)
    taken = {
        identity: [
            (each.header.sequence, each.parts)
            for each in inbox.get_batch(0, 9)
            if isinstance(each, ReceivedParts)
        ]
        for identity, inbox in inboxes.items()
    }
    assert taken == {"a": [(0, [0]), (1, [2])], "c": [(0, [1]), (1, [1]), (2, [1])]}


def test_the_featurizer_is_told_at_once_of_an_image_that_cannot_be_read(stage: Stage) -> None:
    stage.send(7, FrameMessage(image=b"no image"))
    assert stage.raws == [None]
    assert stage.counts == {"unreadable": 1}


def test_the_featurizer_is_told_at_once_of_a_defect(image: bytes) -> None:
    def defective(images: object) -> NDArray[np.float32]:
        raise RuntimeError("a defect")

    stage = Stage(Feature((DescribingPart("gist", None, defective),)))
    with pytest.raises(RuntimeError):
        stage.send(7, FrameMessage(image=image))
    assert stage.raws == [None]


def test_a_given_descriptor_is_left_to_the_featurizer(stage: Stage) -> None:
    stage.send(7, FrameMessage(descriptor=np.ones(9, np.float32)))
    assert not stage.publisher.sent


def test_garbage_is_refused(stage: Stage) -> None:
    with pytest.raises(MessageError):
        stage.send(7, b"\xc1")
    assert not stage.publisher.sent


def test_a_map_of_descriptors_needs_no_describer(route_map: Map) -> None:
    of_descriptors = replace(route_map, model=replace(route_map.model, kind="descriptor"))
    with pytest.raises(ConfigError, match="descriptors need no describer"):
        run_describer(of_descriptors, Config(), threading.Event())
