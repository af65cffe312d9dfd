import numpy as np
import pytest

from placefield.features.perturbations import KINDS, perturb

SEEDS = range(20)


def scene(shape=(60, 80, 3), seed=0):
    """Coarse random patches with smooth shading, away from black and white."""
    rng = np.random.default_rng(seed)
    patches = rng.integers(40, 200, (shape[0] // 10, shape[1] // 10, *shape[2:]))
    image = patches.repeat(10, axis=0).repeat(10, axis=1)
    return (image + np.arange(shape[1]).reshape(1, -1, *[1] * (len(shape) - 2)) // 4).astype(
        np.uint8
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("shape", [(60, 80), (60, 80, 3)], ids=["grey", "colour"])
def test_size_and_type_stay_and_the_argument_is_left_alone(kind, shape):
    image = scene(shape)
    before = image.copy()
    perturbed = perturb(image, kind, np.random.default_rng(0))
    assert perturbed.shape == shape
    assert perturbed.dtype == np.uint8
    assert (perturbed != before).any()
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("kind", KINDS)
def test_the_generator_alone_decides(kind):
    results = [perturb(scene(), kind, np.random.default_rng(seed)) for seed in (3, 3, 4)]
    np.testing.assert_array_equal(results[0], results[1])
    assert (results[0] != results[2]).any()


def test_brightness_is_a_rising_curve_that_darkens_or_brightens_and_keeps_black_and_white():
    ramp = np.arange(256, dtype=np.uint8).reshape(1, 256)
    curves = [perturb(ramp, "brightness", np.random.default_rng(s))[0].astype(int) for s in SEEDS]
    for curve in curves:
        assert (np.diff(curve) >= 0).all()
        assert curve[[0, 255]].tolist() == [0, 255]
    middle = np.array([curve[128] for curve in curves])
    assert set(np.sign(middle - 128)) == {-1, 1}
    # 255 · 0.5^γ at the ends of the range of γ
    assert (((middle > 54) & (middle < 102)) | ((middle > 158) & (middle < 189))).all()


def test_blur_leaves_flat_images_and_means_and_removes_detail():
    flat = np.full((60, 80), 90, np.uint8)
    for seed in SEEDS:
        np.testing.assert_array_equal(perturb(flat, "blur", np.random.default_rng(seed)), flat)
        image = scene((60, 80))
        blurred = perturb(image, "blur", np.random.default_rng(seed)).astype(float)
        assert np.abs(np.diff(blurred)).max() < np.abs(np.diff(image.astype(float))).max()
        assert blurred.mean() == pytest.approx(image.mean(), abs=1)


def test_noise_has_no_bias_and_the_deviation_it_should():
    grey = np.full((200, 200, 3), 128, np.uint8)
    for seed in SEEDS:
        noise = perturb(grey, "noise", np.random.default_rng(seed)).astype(float) - 128
        assert noise.mean() == pytest.approx(0, abs=0.3)
        assert 9.8 < noise.std() < 25.2
        assert abs(np.corrcoef(noise[..., 0].ravel(), noise[..., 2].ravel())[0, 1]) < 0.03


def test_noise_saturates_instead_of_wrapping():
    for level in (0, 255):
        image = np.full((50, 50), level, np.uint8)
        noisy = perturb(image, "noise", np.random.default_rng(0)).astype(int)
        assert np.abs(noisy - level).max() < 128


def test_shift_moves_sideways_both_ways_and_fills_with_the_edge():
    ramp = np.tile(np.arange(20, 220, dtype=np.uint8), (30, 1))
    moves = []
    for seed in SEEDS:
        shifted = perturb(ramp, "shift", np.random.default_rng(seed)).astype(float)
        assert (shifted == shifted[0]).all()
        moves.append(float((ramp - shifted)[0, 20:-20].mean()))
        expected = np.clip(np.arange(20, 220) - moves[-1], 20, 219)
        np.testing.assert_allclose(shifted[0], expected, atol=1)
    sizes = np.abs(moves)
    assert sizes.min() > 0.019 * 200
    assert sizes.max() < 0.061 * 200
    assert set(np.sign(moves)) == {-1, 1}


def test_an_unknown_kind_is_an_error():
    with pytest.raises(KeyError):
        perturb(scene(), "fog", np.random.default_rng(0))
