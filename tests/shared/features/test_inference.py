from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from networks import HEIGHT, WIDTH, write_network
from numpy.typing import NDArray
from onnx import load
from onnx.reference import ReferenceEvaluator
from scipy.signal import correlate

from placefield.config import InferenceConfig
from placefield.errors import ConfigError, FrameError
from placefield.features.inference import NetworkFeature, network_input
from placefield.features.network import Network, NetworkInput, read_network

Pixels = NDArray[np.uint8]


def noise(*shape: int, seed: int = 1) -> Pixels:
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def loaded(path: Path) -> NetworkFeature:
    return NetworkFeature("net", read_network(path))


def refusal(path: Path) -> str:
    with pytest.raises(ConfigError) as refused:
        loaded(path)
    assert str(refused.value).startswith("net: ")
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "net.onnx"


def test_the_feature_is_the_networks_output_row_by_row(path: Path) -> None:
    mean, deviation = [0.4, 0.5, 0.6], [0.1, 0.2, 0.3]
    kernels = write_network(path, mean=mean, deviation=deviation)
    image = noise(HEIGHT, WIDTH, 3)
    rgb = ((image[..., ::-1] / 255 - mean) / deviation).transpose(2, 0, 1)
    expected = [correlate(rgb, kernel, "valid")[0] for kernel in kernels]
    feature = loaded(path).describe(image)
    assert feature.dtype == np.float32
    np.testing.assert_allclose(feature, np.ravel(expected), rtol=1e-4, atol=1e-4)


def test_the_other_output_and_a_grid_are_means(path: Path) -> None:
    image = noise(HEIGHT, WIDTH, 3)
    write_network(path)
    maps = loaded(path).describe(image).reshape(4, HEIGHT - 2, WIDTH - 2)
    write_network(path, output="gap")
    np.testing.assert_allclose(loaded(path).describe(image), maps.mean(axis=(1, 2)), atol=1e-5)
    write_network(path, grid=2)
    cells = maps.reshape(4, 2, 7, 2, 11).mean(axis=(2, 4))
    np.testing.assert_allclose(loaded(path).describe(image), cells.ravel(), atol=1e-5)


@pytest.mark.parametrize("colour", ["rgb", "bgr", "grey"])
def test_an_image_is_resized_and_its_channels_ordered(colour: Any) -> None:
    wanted = NetworkInput(width=20, height=10, colour=colour, scale=1)
    image = np.full((50, 80, 3), (10, 20, 30), np.uint8)
    luma = 0.114 * 10 + 0.587 * 20 + 0.299 * 30
    values = {"rgb": [30, 20, 10], "bgr": [10, 20, 30], "grey": [round(luma)]}[colour]
    blob = network_input(image, wanted)
    assert blob.dtype == np.float32
    np.testing.assert_array_equal(blob, np.tile(np.reshape(values, (1, -1, 1, 1)), (10, 20)))
    alone = network_input(image[..., 0], wanted)
    np.testing.assert_array_equal(alone, np.full((1, len(values), 10, 20), 10))


def test_a_histogram_is_equalised_where_wanted() -> None:
    wanted = NetworkInput(width=32, height=16, colour="grey", equalise=True)
    dark = np.arange(512, dtype=np.uint16).reshape(16, 32).astype(np.uint8) // 8
    ranks = np.linspace(0, 1, 32)[dark]
    np.testing.assert_allclose(network_input(dark, wanted)[0, 0], ranks, atol=0.005)


def test_pixels_that_are_no_image_are_refused(path: Path) -> None:
    write_network(path)
    for pixels in (noise(16, 24, 4), noise(16), noise(16, 24).astype(np.float32)):
        with pytest.raises(FrameError):
            loaded(path).describe(pixels)  # type: ignore[arg-type]


def test_an_image_whose_output_is_not_finite_is_refused(path: Path) -> None:
    write_network(path, scale=1e36)
    feature = loaded(path)
    with pytest.raises(FrameError, match="not finite"):
        feature.describe(np.full((HEIGHT, WIDTH, 3), 255, np.uint8))


def test_values_depend_on_no_thread_and_no_other_image(path: Path) -> None:
    write_network(path)
    images = [noise(40, 60, 3, seed=seed) for seed in range(40)]
    alone = [loaded(path).describe(image).tobytes() for image in images]
    shared = NetworkFeature("net", read_network(path), InferenceConfig(threads=4))
    with ThreadPoolExecutor(8) as pool:
        assert [feature.tobytes() for feature in pool.map(shared.describe, images)] == alone


@pytest.mark.parametrize(
    ("declared", "reason"),
    [
        ({"output": "map"}, "no output 'map'; the network has 'maps', 'gap'"),
        (
            {"width": 23},
            "its input is tensor(float) ? x 3 x 16 x 24, not tensor(float) 1 x 3 x 16 x 23",
        ),
        ({"colour": "grey"}, "not tensor(float) 1 x 1 x 16 x 24"),
        ({"grid": 15}, "no 15×15 cells"),
        ({"output": "gap", "grid": 2}, "no 2×2 cells"),
    ],
)
def test_a_toml_that_does_not_fit_the_network_is_refused(
    path: Path, declared: dict[str, Any], reason: str
) -> None:
    write_network(path, **declared)
    assert reason in refusal(path)


def test_where_there_are_several_outputs_one_must_be_named(path: Path) -> None:
    write_network(path)
    path.with_suffix(".toml").write_text(f"width = {WIDTH}\nheight = {HEIGHT}\n")
    assert "output is not given; the network has 'maps', 'gap'" in refusal(path)


@pytest.mark.parametrize("share", [0, 0.5, 0.97])
def test_a_file_that_is_no_whole_network_is_refused(path: Path, share: float) -> None:
    write_network(path)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert "onnxruntime can run" in refusal(path)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("calc", NetworkInput(width=160, height=120, colour="grey", equalise=True)),
        (
            "mobilenet_v2_imagenet",
            NetworkInput(
                width=96,
                height=64,
                mean=(0.485, 0.456, 0.406),
                deviation=(0.229, 0.224, 0.225),
                output="conv13",
            ),
        ),
    ],
)
def test_real_networks_give_what_the_reference_implementation_of_onnx_gives(
    models_dir: Path, name: str, wanted: NetworkInput
) -> None:
    file = models_dir / f"{name}.onnx"
    network = Network(wanted, np.fromfile(file, np.uint8))
    image = cv2.GaussianBlur(noise(120, 160, 3), (0, 0), 3)
    model = load(file)
    outputs = [output.name for output in model.graph.output]
    blob = network_input(np.asarray(image, np.uint8), wanted)
    answers = ReferenceEvaluator(model).run(None, {model.graph.input[0].name: blob})
    expected = answers[outputs.index(wanted.output or outputs[0])]
    feature = NetworkFeature(name, network).describe(np.asarray(image, np.uint8))
    np.testing.assert_allclose(feature, expected.ravel(), atol=1e-5 * np.abs(expected).max())
