"""Masks of maps: asked for at the build, kept by the map, applied to each query."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from placefield.config import BuildConfig, Config, InferenceConfig
from placefield.errors import ConfigError, MapError
from placefield.features.extract import feature_of_model
from placefield.features.frames import Frame
from placefield.maps.map import fingerprint
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.build.used_part import AskedPart
from placefield_tools.evaluate.observing import observer
from placefield_tools.inspect.map_facts import map_facts

CONFIG = Config.model_validate({"metric": {"kind": "identity"}, "scales": {"channels": 1}})


@pytest.fixture(scope="module")
def bonnet_dir(reference_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The frames of the reference with a bonnet in the lowest third."""
    folder = tmp_path_factory.mktemp("bonnet")
    for file in sorted(reference_dir.glob("*.jpg")):
        pixels = cv2.imread(str(file))
        assert pixels is not None
        pixels[2 * len(pixels) // 3 :] = (60, 50, 40)
        cv2.imwrite(str(folder / file.name), pixels)
    return folder


def mask_file(folder: Path, height: int, width: int) -> Path:
    painted = np.full((height, width), 255, np.uint8)
    painted[2 * height // 3 :] = 0
    cv2.imwrite(str(folder / "mask.png"), painted)
    return folder / "mask.png"


def painted(folder: Path) -> AskedPart:
    return AskedPart(str(mask_file(folder, 72, 96)))


def test_a_learned_mask_travels_with_the_map(bonnet_dir: Path, tmp_path: Path) -> None:
    built = build_from([str(bonnet_dir)], CONFIG, images=AskedPart("auto"))
    save_map(built, tmp_path / "route.pfmap")
    model = open_map(tmp_path / "route.pfmap").model
    assert model.mask is not None
    assert model.mask.hidden == pytest.approx(1 / 3, abs=0.05)
    assert fingerprint(model) != fingerprint(build_from([str(bonnet_dir)], CONFIG).model)
    assert map_facts(built)["mask"] == f"hides {model.mask.hidden:.0%} of each image"
    describe = feature_of_model(model).describe
    pixels = cv2.imread(str(min(bonnet_dir.glob("*.jpg"))))
    assert pixels is not None
    expected = describe(np.asarray(pixels, np.uint8))
    pixels[2 * len(pixels) // 3 + 2 :] = np.random.default_rng(0).integers(0, 256, 3)
    np.testing.assert_array_equal(describe(np.asarray(pixels, np.uint8)), expected)


def test_a_painted_mask_is_taken_if_it_fits_the_frames(bonnet_dir: Path, tmp_path: Path) -> None:
    built = build_from([str(bonnet_dir)], CONFIG, images=painted(tmp_path))
    assert built.model.mask is not None
    assert built.model.mask.hidden == pytest.approx(1 / 3)
    file = mask_file(tmp_path, 90, 160)
    with pytest.raises(ConfigError, match=rf"^--mask {file}: the image is 96×72, .* 160×90"):
        build_from([str(bonnet_dir)], CONFIG, images=AskedPart(str(file)))
    with pytest.raises(ConfigError, match=r"no\.png: cannot be read: No such file"):
        build_from([str(bonnet_dir)], CONFIG, images=AskedPart(str(tmp_path / "no.png")))


def test_a_drive_in_which_everything_changes_has_no_mask(reference_dir: Path) -> None:
    assert build_from([str(reference_dir)], CONFIG, images=AskedPart("auto")).model.mask is None


def test_local_features_of_a_map_are_not_those_of_what_its_mask_hides(
    bonnet_dir: Path, tmp_path: Path
) -> None:
    file = str(mask_file(tmp_path, 72, 96))
    config = CONFIG.model_copy(update={"build": BuildConfig(local_features=100)})
    built = build_from([str(bonnet_dir)], config, images=AskedPart(file))
    assert built.local_features is not None
    pixels = cv2.imread(str(min(bonnet_dir.glob("*.jpg"))))
    assert pixels is not None
    hidden = pixels[2 * len(pixels) // 3 + 2 :]
    hidden[:] = np.random.default_rng(0).integers(0, 256, hidden.shape)
    frame = Frame(0, 0, "noise", np.asarray(pixels, np.uint8))
    observed = observer(built, InferenceConfig())(frame).local_features
    assert observed is not None
    assert len(observed.points) > 20
    np.testing.assert_array_equal(observed.points, built.local_features.of(0).points)
    np.testing.assert_array_equal(observed.descriptors, built.local_features.of(0).descriptors)


def test_a_mask_of_other_values_refuses_the_map(bonnet_dir: Path, tmp_path: Path) -> None:
    built = build_from([str(bonnet_dir)], CONFIG, images=painted(tmp_path))
    mask = built.model.mask
    assert mask is not None
    for used in (0 * mask.used, 2 * mask.used):
        object.__setattr__(mask, "used", used)
        save_map(built, tmp_path / "bad.pfmap")
        with pytest.raises(MapError, match=r"mask/used.npy: is no mask of 0 and 1"):
            open_map(tmp_path / "bad.pfmap")
