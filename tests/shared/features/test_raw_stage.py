"""Without a map, a frame is described by its raw feature."""

from pathlib import Path

import numpy as np
import pytest
from lenses import pinhole
from networks import write_network

from placefield.errors import FrameError
from placefield.features.extract import feature_of
from placefield.features.raw_stage import RawStage, raw_fingerprint

IMAGE = np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8)


@pytest.mark.parametrize("kind", ["gist", "grayscale"])
def test_a_frame_is_described_by_its_raw_feature(kind: str) -> None:
    stage = RawStage(kind)
    raw = stage.new_stream().update_raw(stage.feature.describe(IMAGE))
    assert raw is not None
    assert np.array_equal(raw, feature_of(kind).describe(IMAGE))


def test_a_blank_frame_has_none_and_an_unreadable_one_is_refused() -> None:
    stage = RawStage("gist")
    assert stage.new_stream().update_raw(stage.feature.describe(np.full_like(IMAGE, 7))) is None
    with pytest.raises(FrameError):
        stage.feature.describe(b"no image")


def test_the_fingerprint_names_the_feature_and_of_a_network_its_content(tmp_path: Path) -> None:
    first, second = tmp_path / "first.onnx", tmp_path / "second.onnx"
    for path in (first, second):
        write_network(path)
    kinds = ["gist", "grayscale", f"onnx:{first}"]
    fingerprints = {raw_fingerprint(kind) for kind in kinds}
    assert len(fingerprints) == 3
    assert all(len(each) == 16 and int(each, 16) >= 0 for each in fingerprints)
    assert raw_fingerprint(f"onnx:{second}") in fingerprints


def test_a_camera_has_a_fingerprint_of_its_own() -> None:
    one, other = pinhole(64, 48, 50).calibration, pinhole(64, 48, 51).calibration
    assert len({raw_fingerprint("gist", camera) for camera in (None, one, other)}) == 3
    assert raw_fingerprint("gist", None) == raw_fingerprint("gist")
