"""Rectified images are those of a pinhole camera, by the formulas of the cameras."""

from contextlib import suppress
from dataclasses import replace

import cv2
import numpy as np
import pytest
from lenses import Array, Lens, pinhole
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError
from placefield.features.calibration import WIDEST, Calibration, View
from placefield.features.frames import Frame
from placefield.features.rectification import check_calibrated, image_of, rectify, view_of

BARREL = Lens("pinhole", (-0.25, 0.05), 320, 240, (190.0, 200.0), (155.0, 124.0))
PINCUSHION = Lens("pinhole", (0.15, 0.0), 320, 240, (300.0, 300.0), (159.5, 119.5))
FISHEYE = Lens("fisheye", (0.04, -0.01, 0.002, 0.0), 320, 240, (190.0, 188.0), (161.0, 117.0))
WIDE = Lens("fisheye", (0.0, 0.0, 0.0, 0.0), 320, 240, (90.0, 90.0), (159.5, 119.5))


def scene(x: Array, y: Array) -> Array:
    """Return grey levels that tell rays apart."""
    return np.asarray(128 + 60 * np.sin(7 * x + 2) + 60 * np.cos(6 * y - 3 * x))


def rays_of(view: View, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Return the rays of the pixels of a pinhole camera's image."""
    height, width = shape
    columns, rows = np.meshgrid(np.arange(width), np.arange(height))
    x = (2 * (columns + 0.5) / width - 1) * view.half_width
    y = (2 * (rows + 0.5) / height - 1) * view.half_height
    return np.asarray(x), np.asarray(y)


@pytest.mark.parametrize("lens", [BARREL, PINCUSHION, FISHEYE])
@pytest.mark.parametrize("scale", [1, 2])
def test_a_rectified_image_is_what_a_pinhole_camera_would_take(lens: Lens, scale: int) -> None:
    view = view_of(lens.calibration)
    (fx, fy), (cx, cy) = lens.focal, lens.centre
    larger = Lens(
        lens.model,
        lens.k,
        lens.width * scale,
        lens.height * scale,
        (fx * scale, fy * scale),
        (scale * (cx + 0.5) - 0.5, scale * (cy + 0.5) - 0.5),
    )
    rectified = rectify(larger.image(scene), lens.calibration, view)  # of the smaller image
    expected = scene(*rays_of(view, rectified.shape))
    assert np.abs(rectified - expected).max() < 4
    colour = np.repeat(larger.image(scene)[..., None], 3, axis=2)
    assert rectify(colour, lens.calibration, view).shape == (*rectified.shape, 3)


@pytest.mark.parametrize("lens", [BARREL, FISHEYE])
def test_the_view_of_a_jpeg_is_rendered_from_a_part_that_is_large_enough(lens: Lens) -> None:
    widest = view_of(lens.calibration)
    half = View(half_width=widest.half_width / 2, half_height=widest.half_height / 2)
    jpeg = cv2.imencode(".jpg", cv2.resize(lens.image(scene), (1280, 960)))[1].tobytes()
    taken = Frame(0, 0, "a", jpeg, calibration=lens.calibration)
    for view in (widest, half):
        shorter = min(image_of(taken, view).shape)
        for n in (2, 4):
            part = image_of(taken, view, shorter // n - 1)
            assert min(part.shape) == pytest.approx(shorter / n, abs=1)
            assert np.abs(part - scene(*rays_of(view, part.shape))).mean() < 3


def in_image(lens: Lens, half_width: float, half_height: float) -> NDArray[np.bool_]:
    along = np.linspace(-1, 1, 1001)
    x = half_width * np.concatenate([along, along, np.full(1001, -1.0), np.full(1001, 1.0)])
    y = half_height * np.concatenate([np.full(1001, -1.0), np.full(1001, 1.0), along, along])
    column, row = lens.pixels(x, y)
    is_in_row = (column >= -0.5) & (column <= lens.width - 0.5)
    return np.asarray(is_in_row & (row >= -0.5) & (row <= lens.height - 0.5))


@pytest.mark.parametrize("lens", [BARREL, PINCUSHION, FISHEYE])
def test_the_view_of_a_camera_has_no_black_border_and_cannot_be_larger(lens: Lens) -> None:
    view = view_of(lens.calibration)
    assert in_image(lens, 0.999 * view.half_width, 0.999 * view.half_height).all()
    assert not in_image(lens, 1.01 * view.half_width, 1.01 * view.half_height).all()


def test_the_view_of_a_camera_without_distortion_is_its_image() -> None:
    view = view_of(pinhole(320, 240, 200).calibration)
    assert (view.half_width, view.half_height) == pytest.approx((0.8, 0.6), abs=1e-6)
    assert view.focal == pytest.approx(200 / 320)
    assert view.degrees == pytest.approx((77.32, 61.93), abs=0.01)
    image = np.random.default_rng(0).integers(0, 256, (240, 320), np.uint8)
    same = rectify(image, pinhole(320, 240, 200).calibration, view)
    assert np.abs(same.astype(int) - image).max() <= 8  # OpenCV's maps are in 1/32 of a pixel


def test_a_view_is_not_wider_than_120_degrees() -> None:
    assert WIDE.pixels(np.array([WIDEST]), np.array([0.0]))[0] < 320  # the camera sees more
    assert view_of(WIDE.calibration).half_width == WIDEST


def test_a_view_ends_where_the_distortion_turns_back() -> None:
    k1 = -0.3  # r (1 + k1 r²) grows up to r = 1.05
    folded = replace(BARREL, k=(k1, 0.0), focal=(190.0, 190.0))
    assert in_image(folded, 5.0, 0.01).sum() > 0  # it leads back into the image
    view = view_of(folded.calibration)
    assert np.hypot(view.half_width, view.half_height) < (-3 * k1) ** -0.5


def test_a_camera_that_sees_nothing_around_its_principal_point_has_no_view() -> None:
    outside = replace(BARREL, centre=(500.0, 120.0))
    with pytest.raises(ConfigError, match="no image around its principal point"):
        view_of(outside.calibration)


def test_the_common_view_of_two_cameras_is_what_both_fill() -> None:
    wide, tall = View(half_width=1.2, half_height=0.4), View(half_width=0.5, half_height=0.6)
    assert wide.common(tall) == View(half_width=0.5, half_height=0.4)


def frame(lens: Lens | None, size: tuple[int, int] = (240, 320)) -> Frame:
    calibration = None if lens is None else lens.calibration
    return Frame(0, 0, "a", np.zeros(size, np.uint8), calibration=calibration)


def test_frames_of_a_camera_that_does_not_fit_the_view_are_refused() -> None:
    view = view_of(BARREL.calibration)
    narrow = pinhole(320, 240, 400)
    for given, of_map, reason in (
        (frame(None), view, "give the camera's calibration, as by --camera"),
        (frame(BARREL), None, "leave the camera's calibration out"),
        (frame(BARREL, (240, 240)), view, "240×240, .* calibrated for 320×240, of another aspect"),
        (frame(narrow), view, r"sees only \d\d% of the map's view, .* with --query-camera"),
    ):
        with pytest.raises(FrameError, match=reason):
            image_of(given, of_map)
    check_calibrated(pinhole(320, 240, 150).calibration, view)  # sees more
    assert image_of(frame(None), None).shape == (240, 320)


def test_no_calibration_of_a_client_makes_a_large_image() -> None:
    view = View(half_width=WIDEST, half_height=1.0)
    jpeg = cv2.imencode(".jpg", frame(None).pixels())[1].tobytes()
    for focal in (5e-324, 1e-6, 1e6):
        given = BARREL.calibration.model_copy(update={"focal": (focal, focal)})
        assert max(rectify(frame(None).pixels(), given, view).shape) <= 320
        with suppress(FrameError):  # no other error
            assert max(image_of(Frame(0, 0, "a", jpeg, calibration=given), view, 60).shape) <= 320


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
@pytest.mark.parametrize("seed", range(10))
def test_a_calibration_of_extreme_numbers_is_used_or_refused(model: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    given = {
        "model": model,
        "width": 320,
        "height": 240,
        "focal": tuple(10 ** rng.uniform(-9, 6, 2)),
        "centre": tuple(rng.choice([-1e6, 0.0, 120.0, 1e6], 2)),
        "distortion": tuple(rng.choice([-1e6, -0.3, 0.0, 1e-300, 1e6], 4)),
    }
    camera = Frame(0, 0, "a", frame(None).pixels(), calibration=Calibration.model_validate(given))
    with suppress(FrameError):  # no other error, and no warning of numpy
        assert max(image_of(camera, View(half_width=0.5, half_height=0.4)).shape) <= 320


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("distortion", (0.1, 0.2)),
        ("distortion", (0.1, 0.2, float("nan"), 0.0)),
        ("focal", (0.0, 1.0)),
        ("width", 7),
        ("model", "mirror"),
    ],
)
def test_a_calibration_of_no_camera_is_refused(key: str, value: object) -> None:
    with pytest.raises(ValueError, match=key):
        Calibration.model_validate({**BARREL.calibration.model_dump(), key: value})
