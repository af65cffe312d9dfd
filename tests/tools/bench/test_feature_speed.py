"""Any feature from JPEG to descriptor, on small frames and for no time."""

from functools import partial
from pathlib import Path

import pytest
from networks import write_network

from placefield.errors import ConfigError
from placefield_tools.bench import feature_speed
from placefield_tools.bench.features import bench_features
from placefield_tools.bench.figure import as_object
from placefield_tools.bench.timing import Timings


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = partial(Timings.of, limit_s=0.0)
    monkeypatch.setattr(feature_speed.Timings, "of", quick)
    monkeypatch.setattr(feature_speed, "_SIZES", ((320, 240),))


@pytest.mark.parametrize("kind", ["gist", "gist+onnx:{network}"])
def test_a_feature_of_one_or_more_parts_is_measured_beside_decoding(
    kind: str, tmp_path: Path
) -> None:
    write_network(tmp_path / "net.onnx")
    kind = kind.format(network=tmp_path / "net.onnx")
    figures = as_object(bench_features(kind))
    assert list(figures) == ["feature_320x240_ms", "feature_320x240_over_decoding"]
    assert figures["feature_320x240_over_decoding"] > 1


def test_descriptors_are_no_feature_of_images() -> None:
    with pytest.raises(ConfigError, match="--feature descriptor: give a feature of images"):
        bench_features("descriptor")
