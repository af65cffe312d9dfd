import cv2
import numpy as np
import pytest

from placefield.errors import FrameError
from placefield.features.images import decode
from placefield_tools.record.thumbnails import small_jpeg


@pytest.mark.parametrize(
    ("size", "small"),
    [
        ((480, 1280), (240, 640)),
        ((72, 96), (72, 96)),
        ((100, 30_000), (2, 640)),
        ((70_000, 8), (640, 1)),
    ],
)
def test_a_picture_is_jpeg_and_no_side_is_longer_than_640(
    size: tuple[int, int], small: tuple[int, int]
) -> None:
    height, width = size
    pixels = np.full((height, width, 3), (20, 120, 220), np.uint8)
    for image in (pixels, cv2.imencode(".png", pixels)[1].tobytes()):
        jpeg = small_jpeg(image)
        assert jpeg.startswith(b"\xff\xd8\xff")
        decoded = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_UNCHANGED)
        assert decoded is not None
        assert decoded.shape[:2] == small
        assert np.abs(decoded.astype(int) - (20, 120, 220)).max() < 8


def test_grey_stays_grey() -> None:
    assert decode(small_jpeg(np.zeros((16, 16), np.uint8))).ndim == 2


@pytest.mark.parametrize("image", [b"", b"no picture", np.zeros((4, 4, 2), np.uint8)])
def test_what_cannot_be_read_is_refused(image: bytes | np.ndarray) -> None:
    with pytest.raises(FrameError):
        small_jpeg(image)
