"""Local features by a network: their conventions, and networks that do not fit."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from local_networks import PATCH, constant_network, write_corner_network
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError
from placefield.features.network import read_onnx
from placefield.verification.local_network import LocalNetwork, as_bytes, try_local_network
from placefield.verification.two_views import count_inliers

Picture = Callable[[int], NDArray[np.uint8]]

IMAGE: NDArray[np.uint8] = np.zeros((60, 80, 3), np.uint8)
# for IMAGE the free axes of an input become 480 x 352
CORNERS = np.array([[0, 0], [479, 351], [239.5, 175.5]], np.float32)
SCORES = np.array([0.1, 0.9, 0.5], np.float32)
DESCRIPTORS = np.random.default_rng(1).normal(size=(3, 96)).astype(np.float32)
GOOD = {"keypoints": CORNERS, "scores": SCORES, "descriptors": DESCRIPTORS}


@pytest.fixture(scope="module")
def corners(tmp_path_factory: pytest.TempPathFactory) -> LocalNetwork:
    path = tmp_path_factory.mktemp("network") / "corners.onnx"
    write_corner_network(path)
    return LocalNetwork("corners", read_onnx(path))


def test_a_shifted_view_has_many_inliers_and_another_scene_few(
    corners: LocalNetwork, picture: Picture
) -> None:
    one, shifted, other = (
        corners.extract(np.ascontiguousarray(pixels), 300)
        for pixels in (picture(1), picture(1)[8:, 12:], picture(2))
    )
    assert one.descriptors.shape == (len(one.points), PATCH**2)
    assert count_inliers(one, shifted, 0) > 60
    assert count_inliers(one, other, 0) < 20


def test_an_image_has_at_most_so_many_and_a_uniform_one_has_none(
    corners: LocalNetwork, picture: Picture
) -> None:
    few, many = (corners.extract(picture(1), count) for count in (20, 100))
    assert len(few.points) == 20
    np.testing.assert_array_equal(few.points, many.points[:20])
    assert corners.extract(np.zeros((60, 80), np.uint8), 10).points.shape == (0, 2)


@pytest.mark.parametrize(
    "outputs",
    [
        GOOD,
        {name: values[None] for name, values in GOOD.items()},
        {**GOOD, "keypoints": np.array([[-1, -1], [1, 1], [0, 0]], np.float32)},
        {**GOOD, "score_map": np.zeros((1, 1, 60, 80), np.float32)},
        {"a": DESCRIPTORS[None], "b": CORNERS[None], "c": SCORES[None]},
    ],
    ids=["plain", "batch", "normalised", "more outputs", "by shape"],
)
def test_points_are_fractions_from_the_middle_strongest_first(outputs: Any) -> None:
    found = LocalNetwork("net", constant_network(outputs)).extract(IMAGE, 2)
    # the last pixel's middle of the input 480 x 352, and the middle of the image of 80 x 60
    expected = [[239.5 / 480, 0.75 * 175.5 / 352], [0, 0]]
    np.testing.assert_allclose(found.points, expected, atol=1e-6)
    np.testing.assert_array_equal(found.descriptors, as_bytes(DESCRIPTORS[[1, 2]]))


def test_an_image_is_brought_to_the_size_of_a_fixed_input() -> None:
    outputs = {**GOOD, "keypoints": np.array([[0, 0], [63, 47], [0, 0]], np.float32)}
    network = LocalNetwork("net", constant_network(outputs, (1, 1, 48, 64)))
    found = network.extract(IMAGE, 1)
    np.testing.assert_allclose(found.points, [[31.5 / 64, 0.75 * 23.5 / 48]], atol=1e-6)


@pytest.mark.parametrize("numbers", [4, 64, 128, 512])
def test_bytes_keep_the_distances_of_descriptors_at_unit_length(numbers: int) -> None:
    given = np.random.default_rng(2).normal(size=(40, numbers)).astype(np.float32)
    unit = given / np.linalg.norm(given, axis=1, keepdims=True)
    stored = as_bytes(3 * given).astype(np.float64)
    expected = np.linalg.norm(unit[:20] - unit[20:], axis=1)
    ratio = np.linalg.norm(stored[:20] - stored[20:], axis=1) / expected
    np.testing.assert_allclose(ratio, np.median(ratio), rtol=0.02)


@pytest.mark.parametrize(
    ("outputs", "reason"),
    [
        ({"feature": DESCRIPTORS}, "which of its outputs are keypoints.*'feature'"),
        ({**GOOD, "scores": SCORES[:2]}, r"scores of \(2,\)"),
        ({**GOOD, "keypoints": CORNERS.repeat(2, 1)}, r"keypoints of shape \(3, 4\)"),
        ({**GOOD, "descriptors": np.stack([DESCRIPTORS] * 2)}, "which has not 2 axes"),
        ({**GOOD, "descriptors": np.zeros((3, 513), np.float32)}, "513 numbers, not 1 to 512"),
        ({**GOOD, "descriptors": np.full_like(DESCRIPTORS, np.nan)}, "not finite"),
        ({**GOOD, "keypoints": CORNERS * 2}, "outside of the image"),
    ],
)
def test_a_network_of_other_outputs_is_refused_in_one_line(outputs: Any, reason: str) -> None:
    with pytest.raises(ConfigError, match=f"^net: gives no local features: .*{reason}.*$"):
        LocalNetwork("net", constant_network(outputs))


@pytest.mark.parametrize("image", [(1, 2, "h", "w"), (1, "c", "h", "w"), (2, 3, "h", "w"), (1, 3)])
def test_a_network_of_another_input_is_refused_in_one_line(image: Any) -> None:
    with pytest.raises(ConfigError, match=r"^net: its input is .*, not tensor\(float\) 1 x 1.*$"):
        LocalNetwork("net", constant_network(GOOD, image))


def test_an_image_that_a_network_fails_on_is_refused_and_others_are_not() -> None:
    network = LocalNetwork("net", constant_network(GOOD, per_brightness="scores"))
    with pytest.raises(FrameError, match=r"^the network of local features fails: .*not finite$"):
        network.extract(IMAGE, 10)
    assert len(network.extract(IMAGE + 1, 10).points) == 3
    with pytest.raises(FrameError, match="float32"):
        network.extract(IMAGE.astype(np.float32), 10)  # type: ignore[arg-type]


def test_a_network_is_tried_in_another_process_which_refuses_it_as_this_one_would() -> None:
    try_local_network("net", constant_network(GOOD))
    wrong = constant_network({**GOOD, "scores": SCORES[:2]})
    with pytest.raises(ConfigError, match=r"^net: gives no local features: .*\(2,\)"):
        try_local_network("net", wrong)
    with pytest.raises(ConfigError, match=r"^net: no network that onnxruntime can run"):
        try_local_network("net", np.frombuffer(b"no network", np.uint8))


def test_without_onnxruntime_a_network_is_refused_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ConfigError, match=r"^a network needs onnxruntime, .*placefield\[onnx\]'$"):
        LocalNetwork("net", constant_network(GOOD))


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.onnx: no such network$"):
        read_onnx(tmp_path / "none.onnx")
