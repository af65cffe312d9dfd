import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bus_doubles import RecordingPublisher, header, received
from lenses import Lens
from numpy.typing import NDArray

from placefield.bus.keys import Keys
from placefield.bus.messages import FrameMessage, RawFeatureMessage
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.config import Config
from placefield.errors import ConfigError, MessageError
from placefield.features.extract import DescribingPart, Feature, feature_of_model
from placefield.features.frames import Frame
from placefield.features.rectification import view_of
from placefield.maps.map import Map
from placefield_services.describer import FrameDescriber, run_describer

KEY = Keys("test").frame


class Stage:
    """A describer with its published messages and its counts."""

    def __init__(self, feature: Feature) -> None:
        self.publisher = RecordingPublisher(RawFeatureMessage)
        self.counts: Counter[str] = Counter()
        output = CachedPublisher(self.publisher, ReplayCache())
        self.describer = FrameDescriber(feature, "model", {"test": output}, {"test": self.counts})

    def send(self, sequence: int, frame: FrameMessage | bytes) -> None:
        self.describer.handle(received(KEY, header(sequence), frame))

    @property
    def raws(self) -> list[bytes | None]:
        messages = [message for _, message in self.publisher.sent]
        assert all(isinstance(one, RawFeatureMessage) and one.model == "model" for one in messages)
        return [
            None if one.raw is None else one.raw.tobytes()
            for one in messages
            if isinstance(one, RawFeatureMessage)
        ]


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
