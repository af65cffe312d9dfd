"""Without a map, a frame is described by its raw feature."""

from pathlib import Path

import numpy as np
import pytest
from networks import write_network

from placefield.errors import FrameError
from placefield.features.extract import feature_of
from placefield.features.raw_stage import RawStage

IMAGE = np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8)


@pytest.mark.parametrize("kind", ["gist", "grayscale"])
def test_a_frame_is_described_by_its_raw_feature(kind: str) -> None:
    raw = RawStage(kind).new_stream().update(IMAGE)
    assert raw is not None
    assert np.array_equal(raw, feature_of(kind).describe(IMAGE))


def test_a_blank_frame_has_none_and_an_unreadable_one_is_refused() -> None:
    stream = RawStage("gist").new_stream()
    assert stream.update(np.full_like(IMAGE, 7)) is None
    with pytest.raises(FrameError):
        stream.update(b"no image")


def test_the_fingerprint_names_the_feature_and_of_a_network_its_content(tmp_path: Path) -> None:
    first, second = tmp_path / "first.onnx", tmp_path / "second.onnx"
    for path in (first, second):
        write_network(path)
    kinds = ["gist", "grayscale", f"onnx:{first}"]
    fingerprints = {RawStage(kind).fingerprint for kind in kinds}
    assert len(fingerprints) == 3
    assert all(len(each) == 16 and int(each, 16) >= 0 for each in fingerprints)
    assert RawStage(f"onnx:{second}").fingerprint in fingerprints
