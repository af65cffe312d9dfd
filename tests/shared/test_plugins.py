"""Features of another package: found by name, loaded when asked for, refused in a line."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield import Config, ConfigError, FrameError, Recognizer, build_map, open_map, save_map
from placefield.features.extract import feature_of
from placefield.loading import load_config
from placefield.plugins import has_plugin, load_plugin

Install = Callable[..., Path]

ROWS = """
import numpy as np

def describe(images):
    greys = [pixels if pixels.ndim == 2 else pixels.mean(axis=2) for pixels in images]
    return np.stack([np.resize(grey.mean(axis=1), 40) for grey in greys]).astype(np.float32)
"""


@pytest.fixture
def views() -> list[NDArray[np.uint8]]:
    return [*np.random.default_rng(7).integers(0, 256, (20, 40, 30), np.uint8)]


@pytest.fixture
def rows(install: Install) -> Path:
    return install("rowspack", ROWS, {"placefield.features": {"rows": "rowspack:describe"}})


def test_a_map_of_a_brought_feature_is_built_kept_and_recognised(
    rows: Path, views: list[NDArray[np.uint8]], tmp_path: Path
) -> None:
    config = load_config(None, {"features": {"kind": "rows"}, "scales": {"channels": 1}})
    save_map(build_map(views, config=config), tmp_path / "route.pfmap")
    placemap = open_map(tmp_path / "route.pfmap")
    assert placemap.features.kind == placemap.model.kind == "rows"
    np.testing.assert_allclose(feature_of("rows").describe(views[3]), views[3].mean(axis=1))
    recognizer = Recognizer(placemap, Config.model_validate({"matching": {"rule": "evidence"}}))
    assert [recognizer.update(view).place for view in views] == list(range(20))


def test_a_map_whose_feature_is_gone_opens_and_cannot_be_recognised(
    rows: Path, views: list[NDArray[np.uint8]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = Config.model_validate({"features": {"kind": "rows"}, "scales": {"channels": 1}})
    save_map(build_map(views, config=config), tmp_path / "route.pfmap")
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if folder != str(rows)])
    placemap = open_map(tmp_path / "route.pfmap")  # channels and fuser need no feature
    assert "rows" in repr(placemap)
    with pytest.raises(ConfigError, match="feature 'rows': no installed package brings it"):
        Recognizer(placemap)


def test_it_is_loaded_only_when_it_is_used(install: Install) -> None:
    install(
        "lazypack", "raise RuntimeError('loaded')", {"placefield.features": {"lazy": "lazypack:it"}}
    )
    assert has_plugin("placefield.features", "lazy")
    assert not has_plugin("placefield.sources", "lazy")
    load_config(None, {"features": {"kind": "lazy"}})
    assert "lazypack" not in sys.modules
    with pytest.raises(
        ConfigError, match="lazypack brings it, and lazypack:it cannot be loaded: RuntimeError: lo"
    ):
        feature_of("lazy")


@pytest.mark.parametrize(
    ("code", "value", "reason"),
    [
        ("import nowhere_to_be_found", "badpack:it", "ModuleNotFoundError"),
        ("it = 1", "badpack:other", "AttributeError"),
        ("it =", "badpack:it", "SyntaxError"),
    ],
)
def test_a_broken_one_is_one_line_that_names_its_package(
    install: Install, code: str, value: str, reason: str
) -> None:
    install("badpack", code, {"placefield.features": {"bad": value}})
    with pytest.raises(
        ConfigError, match=f"feature 'bad': badpack brings it.*{reason}"
    ) as reported:
        load_plugin("placefield.features", "bad")
    assert "\n" not in str(reported.value)


def test_a_part_of_two_packages_is_refused(install: Install) -> None:
    for name in ("onepack", "otherpack"):
        install(name, "it = 1", {"placefield.features": {"both": f"{name}:it"}})
    with pytest.raises(ConfigError, match="several packages bring it: onepack, otherpack"):
        load_plugin("placefield.features", "both")


def test_a_name_that_no_package_provides_is_refused_where_it_is_given() -> None:
    with pytest.raises(ConfigError, match=r"setting features\.kind: 'rows': give grayscale, gist"):
        load_config(None, {"features": {"kind": "rows"}})
    with pytest.raises(ConfigError, match="feature 'rows': no installed package"):
        feature_of("rows")


def test_a_name_of_ours_is_ours_whoever_brings_it(
    install: Install, views: list[NDArray[np.uint8]]
) -> None:
    plain = feature_of("gist").describe(views[0])
    install("gistpack", "raise RuntimeError", {"placefield.features": {"gist": "gistpack:it"}})
    np.testing.assert_array_equal(feature_of("gist").describe(views[0]), plain)


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ("np.zeros((2, 2))", r"gives shape \(2, 2\) for 1 images; it must give \(B, D\)"),
        ("np.zeros(9)", r"gives shape \(9,\) for"),
        ("np.zeros((1, 0))", r"gives shape \(1, 0\)"),
        ("3.0", r"gives shape \(\)"),
        ("np.full((1, 9), np.nan)", "gives numbers that are not finite"),
    ],
)
def test_a_feature_of_another_shape_or_not_finite_is_refused(
    install: Install, views: list[NDArray[np.uint8]], given: str, reason: str
) -> None:
    code = f"import numpy as np\n\ndef it(images):\n    return {given}\n"
    name = f"shape{abs(hash(given))}"
    install(name, code, {"placefield.features": {"shaped": f"{name}:it"}})
    with pytest.raises(FrameError, match=f"feature 'shaped': {reason}"):
        feature_of("shaped").describe(views[0])
