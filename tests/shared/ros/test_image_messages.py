import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.errors import FrameError
from placefield.ros.image_messages import ENCODINGS, decode_image

HEIGHT, WIDTH = 12, 10
BGR = cv2.GaussianBlur(
    np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8), (5, 5), 2
)
GREY = BGR[:, :, 0]

# cv_bridge's table of a Bayer pattern's first four pixels, in OpenCV's names by the second row.
BAYER = {
    "bayer_rggb8": cv2.COLOR_BayerBG2BGR,
    "bayer_bggr8": cv2.COLOR_BayerRG2BGR,
    "bayer_gbrg8": cv2.COLOR_BayerGR2BGR,
    "bayer_grbg8": cv2.COLOR_BayerGB2BGR,
}


def decoded(encoding: str, rows: NDArray[np.generic], *, padding: int = 0) -> NDArray[np.uint8]:
    """Decode an image with these rows (H, W, ...), padded."""
    flat = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), -1)
    padded = np.pad(flat, ((0, 0), (0, padding)), constant_values=77)
    big = rows.dtype.byteorder == ">"
    return decode_image(HEIGHT, WIDTH, encoding, big, padded.shape[1], padded.tobytes())


@pytest.mark.parametrize(
    ("encoding", "rows"),
    [
        ("bgr8", BGR),
        ("8UC3", BGR),
        ("rgb8", BGR[:, :, ::-1]),
        ("bgra8", cv2.cvtColor(BGR, cv2.COLOR_BGR2BGRA)),
        ("rgba8", cv2.cvtColor(BGR, cv2.COLOR_BGR2RGBA)),
    ],
)
@pytest.mark.parametrize("padding", [0, 5])
def test_colour_comes_as_bgr(encoding: str, rows: NDArray[np.uint8], padding: int) -> None:
    np.testing.assert_array_equal(decoded(encoding, rows, padding=padding), BGR)


@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_grey_stays_grey(encoding: str) -> None:
    np.testing.assert_array_equal(decoded(encoding, GREY, padding=3), GREY)


@pytest.mark.parametrize("dtype", ["<u2", ">u2"])
@pytest.mark.parametrize("encoding", ["mono16", "16UC1"])
def test_16_bits_are_scaled_whatever_their_byte_order(encoding: str, dtype: str) -> None:
    np.testing.assert_array_equal(decoded(encoding, GREY.astype(dtype) * 257, padding=2), GREY)
    np.testing.assert_array_equal(decoded("rgb16", BGR[..., ::-1].astype(dtype) * 257), BGR)


@pytest.mark.parametrize(("encoding", "conversion"), BAYER.items())
def test_bayer_is_filled_in_as_opencv_does(encoding: str, conversion: int) -> None:
    expected = cv2.cvtColor(GREY, conversion)
    np.testing.assert_array_equal(decoded(encoding, GREY), expected)
    wide = decoded(encoding.replace("8", "16"), GREY.astype("<u2") * 257).astype(int)
    assert abs(wide - expected).max() <= 1  # two roundings


@pytest.mark.parametrize("encoding", BAYER)
def test_a_bayer_pattern_of_one_colour_is_that_colour(encoding: str) -> None:
    value = {"b": 10, "g": 120, "r": 250}
    cell = np.array([value[letter] for letter in encoding[6:10]], np.uint8).reshape(2, 2)
    picture = decoded(encoding, np.tile(cell, (HEIGHT // 2, WIDTH // 2)))
    assert (picture == [10, 120, 250]).all()


@pytest.mark.parametrize("encoding", ["uyvy", "yuv422", "yuyv", "yuv422_yuy2"])
def test_a_grey_4_2_2_image_is_its_luma(encoding: str) -> None:
    luma, chroma = np.full((HEIGHT, WIDTH), 126, np.uint8), np.full((HEIGHT, WIDTH), 128, np.uint8)
    pair = (chroma, luma) if encoding in ("uyvy", "yuv422") else (luma, chroma)
    assert (decoded(encoding, np.stack(pair, axis=2)) == 128).all()  # BT.601: (126 - 16) · 1.164


def test_the_last_row_may_lack_its_padding() -> None:
    padded = np.pad(GREY, ((0, 0), (0, 6))).tobytes()[:-6]
    image = decode_image(HEIGHT, WIDTH, "mono8", False, WIDTH + 6, padded)
    np.testing.assert_array_equal(image, GREY)


@pytest.mark.parametrize(
    ("how", "what"),
    [
        ({"encoding": "32FC1"}, "'32FC1'; give one of mono8"),
        ({"data": GREY.tobytes()[:-1]}, "has 119 bytes in rows of 10"),
        ({"step": WIDTH - 1}, "rows of 9; it needs rows of 10"),
        ({"height": 0}, "is 10×0; give at least 8×8"),
        ({"width": 2**31, "height": 2**31}, "at most 64000000 pixels"),
    ],
)
def test_fields_that_do_not_fit_are_reported(how: dict[str, object], what: str) -> None:
    fields = {
        "height": HEIGHT,
        "width": WIDTH,
        "encoding": "mono8",
        "is_bigendian": False,
        "step": WIDTH,
        "data": GREY.tobytes(),
    }
    with pytest.raises(FrameError, match=what):
        decode_image(**(fields | how))  # type: ignore[arg-type]


@given(
    st.integers(-1, 2**32),
    st.integers(7, 12),
    st.sampled_from([*ENCODINGS, "", "bayer"]),
    st.booleans(),
    st.integers(-1, 2**32) | st.integers(0, 60),
    st.binary(max_size=900),
)
def test_no_message_gives_anything_but_pixels_or_a_frame_error(
    height: int, width: int, encoding: str, big: bool, step: int, data: bytes
) -> None:
    for rows in (height, 8):
        try:
            pixels = decode_image(rows, width, encoding, big, step, data)
        except FrameError:
            continue
        assert pixels.dtype == np.uint8
        assert pixels.shape in ((rows, width), (rows, width, 3))
