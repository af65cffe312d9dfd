from pathlib import Path

import pytest
from networks import write_network

from placefield.errors import ConfigError
from placefield.features.network import read_network


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_network(tmp_path / "net.onnx")
    return tmp_path / "net.onnx"


def test_the_network_and_its_toml_are_read_and_what_is_not_said_has_its_default(path: Path) -> None:
    path.with_suffix(".toml").write_text("width = 24\nheight = 16\nmean = [1, 2.5, 3]\n")
    network = read_network(path)
    assert network.onnx.tobytes() == path.read_bytes()
    assert network.input.model_dump() == {
        "width": 24,
        "height": 16,
        "colour": "rgb",
        "equalise": False,
        "scale": 1 / 255,
        "mean": (1, 2.5, 3),
        "deviation": 1,
        "output": None,
        "grid": None,
    }


def test_a_digest_is_of_the_network_and_of_what_its_toml_means(path: Path) -> None:
    digest = read_network(path).digest
    toml = path.with_suffix(".toml")
    said = toml.read_text()
    toml.write_text(f"# the same\ncolour = 'rgb'\n{said}")
    assert read_network(path).digest == digest
    toml.write_text(f"colour = 'bgr'\n{said}")
    assert read_network(path).digest != digest
    toml.write_text(said)
    path.write_bytes(path.read_bytes() + b"\n")
    assert read_network(path).digest != digest


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("height = 16\n", "width: Field required"),
        ("width = 0\nheight = 16\n", "width: "),
        ("width = 24\nheight = 16\nwitdh = 24\n", "witdh: "),
        ("width = 24\nheight = 16\ncolour = 'hsv'\n", "colour: "),
        ("width = 24\nheight = 16\nmean = [1, 2]\n", "mean has 2 values for 3 channels"),
        ("width = 24\nheight = 16\ncolour = 'grey'\ndeviation = [1, 1, 1]\n", "for 1 channel"),
        ("width = 24\nheight = 16\ndeviation = [1, 0, 1]\n", "deviation must be above 0"),
        ("width = 24\nheight = 16\nscale = inf\n", "scale: "),
        ("width = 24\nheight = 16\nequalise = true\n", "equalise is for colour"),
        ("width = 24\nheight = 16\ngrid = 0\n", "grid: "),
        ("width = \n", "not valid TOML"),
        ("width = 24\0", "not valid TOML"),
    ],
)
def test_a_toml_that_is_malformed_is_named_with_the_key(path: Path, text: str, reason: str) -> None:
    toml = path.with_suffix(".toml")
    toml.write_text(text)
    with pytest.raises(ConfigError) as refused:
        read_network(path)
    assert str(refused.value).startswith(f"{toml}: ")
    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_missing_is_named(path: Path) -> None:
    toml = path.with_suffix(".toml")
    toml.unlink()
    with pytest.raises(ConfigError, match=rf"^{toml}: no such file"):
        read_network(path)
    path.unlink()
    with pytest.raises(ConfigError, match=rf"^{path}: no such network"):
        read_network(path)
    path.mkdir()
    with pytest.raises(ConfigError, match=rf"^{path}: cannot be read"):
        read_network(path)
