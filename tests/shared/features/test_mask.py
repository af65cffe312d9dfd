import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from placefield.errors import ConfigError, FrameError
from placefield.features.descriptor_stage import large_frame
from placefield.features.mask import LEAST_FRAMES, Mask, learn_mask, learning_image, read_mask

Pixels = NDArray[np.uint8]
HEIGHT, WIDTH = 90, 160


def pan(count: int, step: int = 12) -> list[Pixels]:
    """Return the frames of a camera that pans along a wall of random colours."""
    rng = np.random.default_rng(5)
    wall = np.zeros((HEIGHT, WIDTH + step * count, 3), np.float32)
    for grain in (4, 16, 48):
        colours = rng.random((HEIGHT // grain + 2, wall.shape[1] // grain + 2, 3), np.float32)
        wall += cv2.resize(colours, wall.shape[1::-1])
    pixels = (255 * (wall - wall.min()) / np.ptp(wall)).astype(np.uint8)
    return [pixels[:, step * n : step * n + WIDTH].copy() for n in range(count)]


def overlaid(image: Pixels, number: int) -> Pixels:
    """Return the image with a bonnet and a clock, as a camera would compress it."""
    drawn = image.copy()
    cv2.ellipse(drawn, (80, 105), (100, 38), 0, 0, 360, (40, 38, 36), -1)
    drawn[2:16, 2:112] = 0
    clock = f"12:{number // 60:02}:{number % 60:02}"
    cv2.putText(drawn, clock, (6, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1)
    return cv2.imdecode(cv2.imencode(".jpg", drawn)[1], cv2.IMREAD_COLOR)  # type: ignore[return-value]


def overlay() -> NDArray[np.bool_]:
    """Return where ``overlaid`` draws, (HEIGHT, WIDTH)."""
    blank = np.full((HEIGHT, WIDTH, 3), 200, np.uint8)
    drawn = cv2.ellipse(blank.copy(), (80, 105), (100, 38), 0, 0, 360, (0, 0, 0), -1)
    drawn[2:16, 2:112] = 0
    return np.asarray((drawn != blank).any(axis=2))


def test_a_hidden_pixel_is_as_the_nearest_used_one() -> None:
    used = (np.random.default_rng(1).random((30, 40)) < 0.02).astype(np.uint8)
    number = np.arange(30 * 40, dtype=np.uint16).reshape(30, 40)  # names each pixel
    image = np.stack([number % 256, number // 256, 0 * number], axis=2).astype(np.uint8)
    masked = Mask(used).apply(image).astype(int)
    source = masked[..., 0] + 256 * masked[..., 1]
    rows, columns = np.mgrid[:30, :40]
    distance = np.hypot(rows - source // 40, columns - source % 40)
    assert used.ravel()[source.ravel()].all()
    nearest = distance_transform_edt(1 - used)
    assert (distance <= 1.05 * nearest + 1e-9).all()  # OpenCV's distances are approximate
    assert (masked == image)[used == 1].all()


def test_what_is_hidden_makes_no_difference() -> None:
    rng = np.random.default_rng(2)
    used = (rng.random((30, 40)) < 0.7).astype(np.uint8)
    for shape in ((30, 40), (30, 40, 3)):
        one, other = rng.integers(0, 256, (2, *shape), np.uint8)
        other[used == 1] = one[used == 1]
        np.testing.assert_array_equal(Mask(used).apply(one), Mask(used).apply(other))


def test_a_mask_is_scaled_to_images_of_its_aspect_ratio_and_refuses_others() -> None:
    used = np.ones((9, 16), np.uint8)
    used[6:] = 0
    image = np.random.default_rng(3).integers(0, 256, (540, 960, 3), np.uint8)
    masked = Mask(used).apply(image)
    np.testing.assert_array_equal(masked[:360], image[:360])
    np.testing.assert_array_equal(masked[360:], np.broadcast_to(image[359], (180, 960, 3)))
    with pytest.raises(FrameError, match="640×480, and its mask is 16×9, of another aspect ratio"):
        Mask(used).apply(np.zeros((480, 640, 3), np.uint8))


def encoded(pixels: Pixels) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def test_black_is_hidden_and_any_other_colour_used() -> None:
    painted = np.zeros((20, 30, 3), np.uint8)
    painted[:, 10:] = (0, 0, 255)
    mask = read_mask(encoded(painted), "mask.png")
    np.testing.assert_array_equal(mask.used, (painted > 0).any(axis=2))
    assert mask.hidden == pytest.approx(1 / 3)
    np.testing.assert_array_equal(read_mask(encoded(painted[..., 2]), "grey").used, mask.used)
    for image, reason in (
        (b"no image", "do not decode"),
        (encoded(0 * painted), "hides the whole"),
    ):
        with pytest.raises(ConfigError, match=rf"^mask.png: .*{reason}"):
            read_mask(image, "mask.png")


def test_what_never_changes_along_a_drive_is_hidden_and_nothing_else() -> None:
    images = [overlaid(image, number) for number, image in enumerate(pan(80))]
    mask = learn_mask([learning_image(image) for image in images])
    assert mask is not None
    hidden = mask.used == 0
    near = cv2.dilate(overlay().astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    assert hidden[overlay()].mean() > 0.97
    assert hidden[~near].mean() < 0.01
    assert learn_mask([learning_image(image) for image in pan(80)]) is None


def test_no_mask_is_learned_where_a_drive_does_not_show_it() -> None:
    still = [learning_image(pan(1)[0])] * 40
    with pytest.raises(ConfigError, match="does the vehicle move"):
        learn_mask(still)
    few = [learning_image(image) for image in pan(LEAST_FRAMES - 1)]
    with pytest.raises(ConfigError, match=f"at least {LEAST_FRAMES} are needed"):
        learn_mask(few)
    with pytest.raises(ConfigError, match="several sizes"):
        learn_mask([*few, few[0][:-1], few[0]])


def test_images_to_learn_from_are_small_grey_and_of_their_aspect_ratio() -> None:
    assert learning_image(np.zeros((540, 960, 3), np.uint8)).shape == (180, 320)
    assert learning_image(np.zeros((40, 60), np.uint8)).shape == (40, 60)


@pytest.mark.parametrize(("height", "width"), [(90, 160), (120, 160), (480, 640), (64, 64)])
def test_a_featurizer_warms_up_with_a_frame_that_the_mask_fits(height: int, width: int) -> None:
    mask = Mask(np.ones((height, width), np.uint8))
    mask.apply(np.zeros(large_frame(mask), np.uint8))
