"""Images against their raw features, which are made into descriptors one by one."""

from pathlib import Path

import numpy as np
import pytest

from placefield.errors import FrameError
from placefield.features.descriptor_stage import DescriptorStage
from placefield.features.descriptors import DescriptorStream
from placefield.features.extract import feature_of_model
from placefield.features.images import decode
from placefield.maps.map import Map


@pytest.fixture
def images(query_dir: Path) -> list[bytes]:
    return [file.read_bytes() for file in sorted(query_dir.iterdir())[:6]]


def test_an_image_becomes_the_descriptor_of_its_feature(
    route_map: Map, images: list[bytes]
) -> None:
    stage = DescriptorStage(route_map.model)
    encoded, pixels, raw = stage.new_stream(), stage.new_stream(), stage.new_stream()
    by_hand, feature = DescriptorStream(route_map.model), feature_of_model(route_map.model)
    for image in images:
        expected = by_hand.update(feature.describe(image))
        for descriptor in (
            encoded.update(image),
            pixels.update(decode(image)),
            raw.update_raw(stage.feature.describe(image)),
        ):
            assert descriptor is not None
            assert expected is not None
            assert descriptor.tobytes() == expected.tobytes()


def test_what_cannot_be_read_or_shows_nothing_leaves_the_stream_as_it_was(
    route_map: Map, images: list[bytes]
) -> None:
    stage = DescriptorStage(route_map.model)
    stream = stage.new_stream()
    stream.update(images[0])
    before = stream.moments
    with pytest.raises(FrameError):
        stream.update(b"no image")
    with pytest.raises(FrameError):
        stream.update_raw(np.ones(3, np.float32))
    assert stream.update(np.full((48, 64, 3), 99, np.uint8)) is None
    assert stream.moments is before


def test_a_stream_goes_on_from_its_moments(route_map: Map, images: list[bytes]) -> None:
    stage = DescriptorStage(route_map.model)
    whole = stage.new_stream()
    for image in images[:4]:
        whole.update(image)
    rest = stage.new_stream(whole.moments)
    for image in images[4:]:
        one, other = whole.update(image), rest.update(image)
        assert one is not None
        assert other is not None
        assert one.tobytes() == other.tobytes()
