import io
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageOps

from placefield.errors import FrameError
from placefield.features.images import MAX_PIXELS, MAX_SCANS, MIN_SIDE, decode, grey

HEIGHT, WIDTH = 60, 80


def smooth_colour():
    noise = np.random.default_rng(7).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 2)


def encoded(suffix, pixels, *parameters):
    done, data = cv2.imencode(suffix, pixels, parameters)
    assert done
    return data.tobytes()


JPEGS = {
    "baseline": encoded(".jpg", smooth_colour()),
    "progressive": encoded(".jpg", smooth_colour(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "restart markers": encoded(".jpg", smooth_colour(), cv2.IMWRITE_JPEG_RST_INTERVAL, 2),
    "grey": encoded(".jpg", smooth_colour()[..., 0]),
}
PNG = encoded(".png", smooth_colour())


def png_chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(header, *chunks):
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        png_chunk(kind, body) for kind, body in [(b"IHDR", header), *chunks, (b"IEND", b"")]
    )


def with_segment(jpeg, marker, body):
    return jpeg[:2] + bytes([0xFF, marker]) + struct.pack(">H", len(body) + 2) + body + jpeg[2:]


def with_scans(jpeg, count):
    """Repeat the last scan, so that there are so many."""
    starts = [at for at in range(len(jpeg)) if jpeg[at : at + 2] == b"\xff\xda"]
    last, end = jpeg[starts[-1] : -2], jpeg[-2:]
    return jpeg[:-2] + (count - len(starts)) * last + end


def test_a_jpeg_of_thousands_of_scans_is_refused_before_any_is_decoded():
    honest, bomb = (with_scans(JPEGS["progressive"], count) for count in (MAX_SCANS, 6000))
    assert decode(honest).shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(FrameError, match=f"more than {MAX_SCANS} scans"):
        decode(bomb)
    with pytest.raises(FrameError, match="scans"):
        decode(bomb[:-1000])


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".ppm", ".tiff"])
def test_lossless_colour_comes_back_as_bgr(suffix):
    np.testing.assert_array_equal(decode(encoded(suffix, smooth_colour())), smooth_colour())


def test_lossless_grey_stays_two_dimensional():
    plane = smooth_colour()[..., 1]
    np.testing.assert_array_equal(decode(encoded(".png", plane)), plane)


def test_jpeg_comes_close():
    for name in ("baseline", "progressive", "restart markers"):
        assert np.abs(decode(JPEGS[name]).astype(int) - smooth_colour()).mean() < 4
    assert decode(JPEGS["grey"]).shape == (HEIGHT, WIDTH)


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_16_bits_scale_full_range_to_full_range(suffix):
    ramp = np.linspace(0, 65535, HEIGHT * WIDTH).astype(np.uint16).reshape(HEIGHT, WIDTH)
    np.testing.assert_array_equal(
        decode(encoded(suffix, ramp)), np.rint(ramp / 257).astype(np.uint8)
    )
    colour = smooth_colour()
    np.testing.assert_array_equal(decode(encoded(suffix, colour.astype(np.uint16) * 257)), colour)


@pytest.mark.parametrize("scale", [1, 257])
def test_alpha_is_dropped_not_blended(scale):
    colour = smooth_colour()
    pixels = np.dstack([colour, np.zeros((HEIGHT, WIDTH), np.uint8)])
    data = encoded(".png", pixels.astype(np.uint16) * 257 if scale == 257 else pixels)
    np.testing.assert_array_equal(decode(data), colour)


def test_palette_is_resolved():
    indices = np.arange(16 * 16).reshape(16, 16) % 3
    palette = np.array([[10, 20, 30], [200, 100, 0], [5, 250, 99]], np.uint8)
    rows = b"".join(b"\0" + row.astype(np.uint8).tobytes() for row in indices)
    data = png(
        struct.pack(">IIBBBBB", 16, 16, 8, 3, 0, 0, 0),
        (b"PLTE", palette.tobytes()),
        (b"IDAT", zlib.compress(rows)),
    )
    np.testing.assert_array_equal(decode(data), palette[indices][..., ::-1])


@pytest.mark.parametrize("orientation", range(1, 9))
def test_an_image_is_turned_as_its_exif_says(orientation):
    tag = b"Exif\0\0MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    tagged = with_segment(JPEGS["baseline"], 0xE1, tag)
    stored = decode(JPEGS["baseline"])
    expected = {
        1: stored,
        2: stored[:, ::-1],
        3: stored[::-1, ::-1],
        4: stored[::-1],
        5: stored.swapaxes(0, 1),
        6: np.rot90(stored, -1),
        7: stored.swapaxes(0, 1)[::-1, ::-1],
        8: np.rot90(stored),
    }[orientation]
    np.testing.assert_array_equal(decode(tagged), expected)
    pillow = ImageOps.exif_transpose(Image.open(io.BytesIO(tagged)))
    assert pillow.size == decode(tagged).shape[1::-1]


def large_colour(height, width):
    return cv2.resize(smooth_colour(), (width, height), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize(
    ("size", "least_side", "decoded"),
    [
        ((1080, 1920), 128, (135, 240)),
        ((1920, 1080), 128, (240, 135)),
        ((1080, 1920), 136, (270, 480)),  # 1080 / 8 = 135
        ((1080, 1920), 448, (540, 960)),
        ((480, 640), 128, (240, 320)),
        ((720, 1280), 128, (180, 320)),
        ((540, 960), 128, (135, 240)),
        ((540, 1200), 60, (135, 300)),  # 540 / 8 is no whole number
        ((1080, 1921), 128, (1080, 1921)),  # nor is 1921 / 2
        ((240, 320), 128, (240, 320)),
        ((1080, 1920), None, (1080, 1920)),
    ],
)
def test_a_jpeg_is_decoded_to_the_least_part_that_is_large_enough(size, least_side, decoded):
    pixels = large_colour(*size)
    part = decode(encoded(".jpg", pixels), least_side)
    assert part.shape == (*decoded, 3)
    n = size[0] // decoded[0]
    means = pixels.reshape(decoded[0], n, decoded[1], n, 3).mean(axis=(1, 3))
    assert np.abs(part - means).mean() < 2
    assert decode(encoded(".jpg", pixels[..., 0]), least_side).shape == decoded


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tiff", ".webp"])
def test_no_other_format_is_decoded_to_a_part(suffix):
    data = encoded(suffix, large_colour(256, 256))
    np.testing.assert_array_equal(decode(data, 32), decode(data))


def test_a_part_of_an_image_is_turned_as_its_exif_says():
    jpeg = encoded(".jpg", large_colour(480, 640))
    tag = b"Exif\0\0MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x0112, 3, 1, 6, 0, 0)
    turned = decode(with_segment(jpeg, 0xE1, tag), 128)
    np.testing.assert_array_equal(turned, np.rot90(decode(jpeg, 128), -1))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("name", ["baseline", "progressive", "restart markers"])
def test_a_damaged_jpeg_is_refused_in_part_where_it_is_refused_whole(name, seed):
    rng = np.random.default_rng(seed)
    data = bytearray(JPEGS[name])
    for at in rng.integers(2, 700, 4):
        data[at] = rng.integers(256)

    def is_refused(least_side):
        try:
            decode(bytes(data), least_side)
        except FrameError:
            return True
        return False

    assert is_refused(15) == is_refused(None)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95, 0.99])
@pytest.mark.parametrize("data", [*JPEGS.values(), PNG], ids=[*JPEGS, "png"])
def test_a_cut_image_is_refused(data, share):
    cut = data[: int(share * len(data))]
    with pytest.raises(FrameError):
        decode(cut)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("name", JPEGS)
def test_a_cut_jpeg_is_refused_whatever_follows_it(name, share):
    cut = JPEGS[name][: int(share * len(JPEGS[name]))]
    for rest in (bytes(8 * len(cut)), JPEGS[name]):
        with pytest.raises(FrameError):
            decode(cut + rest)


def test_the_end_marker_of_a_thumbnail_is_not_the_end():
    thumbnail = encoded(".jpg", smooth_colour()[:16, :16])
    whole = with_segment(JPEGS["baseline"], 0xE1, thumbnail)
    np.testing.assert_array_equal(decode(whole), decode(JPEGS["baseline"]))
    with pytest.raises(FrameError, match="cut off"):
        decode(whole[: 2 * len(whole) // 3])


@pytest.mark.parametrize("rest", [b"\0" * 999, b"\xff\xd8 a second picture", b"\r\n--boundary"])
@pytest.mark.parametrize("data", [*JPEGS.values(), PNG], ids=[*JPEGS, "png"])
def test_bytes_behind_the_end_are_ignored(data, rest):
    np.testing.assert_array_equal(decode(data + rest), decode(data))


@pytest.mark.parametrize("data", [b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n", b"no image " * 50])
def test_what_is_no_image_is_refused(data):
    with pytest.raises(FrameError):
        decode(data)


@given(st.binary(max_size=200), st.integers(0, len(JPEGS["baseline"])))
def test_damage_gives_pixels_or_a_frame_error(noise, at):
    data = JPEGS["baseline"][:at] + noise + JPEGS["baseline"][at + len(noise) :]
    try:
        pixels = decode(data)
    except FrameError:
        return
    assert pixels.dtype == np.uint8
    assert pixels.ndim in (2, 3)


def test_an_image_of_few_pixels_is_refused():
    for suffix in (".png", ".jpg", ".bmp"):
        assert decode(encoded(suffix, np.zeros((MIN_SIDE, MIN_SIDE), np.uint8))).size
        with pytest.raises(FrameError, match="at least"):
            decode(encoded(suffix, np.zeros((MIN_SIDE - 1, 99), np.uint8)))


def test_a_huge_image_is_refused_by_its_header():
    side = int(MAX_PIXELS**0.5) + 1
    header_only = png(struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0))
    frame_header = b"\xff\xc0\x00\x0b\x08" + struct.pack(">HH", side, side) + b"\x01\x01\x11\x00"
    for data in (header_only, b"\xff\xd8" + frame_header + b"\xff\xd9"):
        with pytest.raises(FrameError, match="at most"):
            decode(data)


def test_floating_point_pixels_are_refused():
    with pytest.raises(FrameError, match="float32"):
        decode(encoded(".tiff", smooth_colour().astype(np.float32)))


def test_grey_is_the_mean_of_the_channels():
    colour = np.random.default_rng(1).integers(0, 256, (50, 70, 3), np.uint8)
    result = grey(colour)
    assert result.dtype == np.float32
    np.testing.assert_array_equal(
        result, (colour.astype(np.float64).sum(axis=2) / 3).astype(np.float32)
    )
    np.testing.assert_array_equal(grey(colour[..., 0]), colour[..., 0].astype(np.float32))


@pytest.mark.parametrize("shape", [(9,), (9, 9, 1), (9, 9, 4), (2, 9, 9, 3)])
def test_grey_refuses_other_shapes(shape):
    with pytest.raises(FrameError, match="shape"):
        grey(np.zeros(shape, np.uint8))


@pytest.mark.parametrize("shape", [(0, 9), (9, 0, 3)])
def test_grey_refuses_an_image_without_a_pixel(shape):
    with pytest.raises(FrameError, match="no pixels"):
        grey(np.empty(shape, np.uint8))


def test_grey_refuses_other_types():
    with pytest.raises(FrameError, match="uint16"):
        grey(np.zeros((9, 9), np.uint16))


def test_real_frames_decode(data_dir):
    folders = [path for path in sorted(data_dir.glob("*/*")) if path.is_dir()]
    assert folders
    for folder in folders:
        frame = min(folder.iterdir())
        assert grey(decode(frame.read_bytes())).ndim == 2


def test_a_small_file_of_a_huge_image_is_refused_before_it_takes_memory(tmp_path: Path) -> None:
    huge = tmp_path / "huge.webp"
    huge.write_bytes(cv2.imencode(".webp", np.zeros((9000, 9000, 3), np.uint8))[1].tobytes())
    assert huge.stat().st_size < 100_000
    code = (
        "import resource, sys\n"
        "from placefield.features.images import decode\n"
        "from placefield.errors import FrameError\n"
        "before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try:\n    decode(open(sys.argv[1], 'rb').read())\n"
        "except FrameError:\n"
        "    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)\n"
    )
    taken = subprocess.run(
        [sys.executable, "-c", code, str(huge)], capture_output=True, text=True, check=True
    )
    assert int(taken.stdout) < 50_000  # KiB; its pixels are 237 MiB
