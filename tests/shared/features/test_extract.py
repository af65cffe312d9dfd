from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from networks import write_network
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError
from placefield.features.extract import Feature, feature_of
from placefield.features.frames import Frame
from placefield.features.network import read_network


@pytest.fixture
def image() -> NDArray[np.uint8]:
    return np.random.default_rng(5).integers(0, 256, (96, 128, 3), np.uint8)


@pytest.fixture(params=["grayscale", "gist", "onnx"])
def feature(request: pytest.FixtureRequest, tmp_path: Path) -> Feature:
    if request.param != "onnx":
        return feature_of(request.param)
    write_network(tmp_path / "net.onnx")
    return feature_of(f"onnx:{tmp_path / 'net.onnx'}")


def png(pixels: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def test_an_encoded_image_and_its_pixels_have_one_feature(
    image: NDArray[np.uint8], feature: Feature
) -> None:
    described = feature.describe(image)
    assert described.ndim == 1
    assert described.dtype == np.float32
    assert np.isfinite(described).all()
    np.testing.assert_array_equal(described, feature.describe(png(image)))


def test_grayscale_is_the_mean_of_blocks_row_by_row(image: NDArray[np.uint8]) -> None:
    blocks = image.reshape(48, 2, 64, 2, 3).mean(axis=(1, 3, 4))
    described = feature_of("grayscale").describe(image)
    np.testing.assert_allclose(described, blocks.ravel(), rtol=1e-5)


def test_a_large_jpeg_is_described_by_a_part_of_its_size(image: NDArray[np.uint8]) -> None:
    large = cv2.resize(image, (1920, 1080), interpolation=cv2.INTER_CUBIC)
    jpeg = cv2.imencode(".jpg", large)[1]
    for kind in ("gist", "grayscale"):
        feature = feature_of(kind)
        quarter = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_REDUCED_COLOR_4), np.uint8)
        assert quarter.shape == (270, 480, 3)
        described = feature.describe(jpeg.tobytes())
        np.testing.assert_array_equal(described, feature.describe(quarter))
        whole = feature.describe(large)
        assert np.linalg.norm(described - whole) < 0.02 * np.linalg.norm(whole)


def test_for_gist_a_camera_s_usual_image_is_decoded_to_half_its_sides(
    image: NDArray[np.uint8],
) -> None:
    jpeg = cv2.imencode(".jpg", cv2.resize(image, (640, 480), interpolation=cv2.INTER_CUBIC))[1]
    half = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_REDUCED_COLOR_2), np.uint8)
    gist, grayscale = feature_of("gist"), feature_of("grayscale")
    np.testing.assert_array_equal(gist.describe(jpeg.tobytes()), gist.describe(half))
    whole = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR), np.uint8)
    np.testing.assert_array_equal(grayscale.describe(jpeg.tobytes()), grayscale.describe(whole))


def test_a_feature_of_several_parts_needs_the_image_of_the_most_demanding(
    tmp_path: Path, install: Callable[..., Path]
) -> None:
    network = f"onnx:{tmp_path / 'net.onnx'}"
    write_network(tmp_path / "net.onnx")
    wide = read_network(tmp_path / "net.onnx").input
    assert feature_of(network).least_side == 4 * max(wide.width, wide.height)
    assert feature_of("gist").least_side == 240
    assert feature_of(f"gist+{network}").least_side == max(240, 4 * max(wide.width, wide.height))
    install(
        "ownpack", "def describe(images): ...", {"placefield.features": {"own": "ownpack:describe"}}
    )
    assert feature_of("own").least_side is None  # it gets whole images
    write_network(tmp_path / "net.onnx", channels=1, colour="grey", equalise=True)
    assert feature_of(network).least_side is None  # small differences would become large ones
    described = feature_of("gist").describing + feature_of("own").describing
    assert Feature(described).least_side is None


def test_a_damaged_image_is_refused(image: NDArray[np.uint8], feature: Feature) -> None:
    with pytest.raises(FrameError):
        feature.describe(png(image)[:500])


def test_a_network_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=rf"^{tmp_path}/no\.onnx: no such network"):
        feature_of(f"onnx:{tmp_path}/no.onnx")


def test_a_frame_has_the_same_feature_whichever_parts_are_described_before(
    image: NDArray[np.uint8],
) -> None:
    feature, frame = feature_of("gist+grayscale"), Frame(0, 0, "", png(image))
    whole = feature.describe(image).tobytes()
    grey = feature.parts_of_frame(frame, [1])
    assert feature.of_frame(frame, grey).tobytes() == whole
    both = {**grey, **feature.parts_of_frame(frame, [0])}
    assert feature.of_frame(Frame(0, 0, "", b"not read"), both).tobytes() == whole
