from typing import get_args

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.config import FeatureKind
from placefield.errors import FrameError
from placefield.features.extract import KINDS, raw_feature

EVERY_KIND = get_args(FeatureKind)


@pytest.fixture
def image() -> NDArray[np.uint8]:
    return np.random.default_rng(5).integers(0, 256, (96, 128, 3), np.uint8)


def png(pixels: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_an_encoded_image_and_its_pixels_have_one_feature(
    image: NDArray[np.uint8], kind: FeatureKind
) -> None:
    feature = raw_feature(image, kind)
    assert feature.shape == (KINDS[kind].raw_dimensions,)
    assert feature.dtype == np.float32
    assert np.isfinite(feature).all()
    np.testing.assert_array_equal(feature, raw_feature(png(image), kind))


def test_grayscale_is_the_mean_of_blocks_row_by_row(image: NDArray[np.uint8]) -> None:
    blocks = image.reshape(48, 2, 64, 2, 3).mean(axis=(1, 3, 4))
    np.testing.assert_allclose(raw_feature(image, "grayscale"), blocks.ravel(), rtol=1e-5)


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_a_damaged_image_is_refused(image: NDArray[np.uint8], kind: FeatureKind) -> None:
    with pytest.raises(FrameError):
        raw_feature(png(image)[:500], kind)
