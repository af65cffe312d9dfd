"""The settings of ``inference`` reach the network wherever frames are described."""

import threading
from collections.abc import Callable
from pathlib import Path

import onnxruntime
import pytest
from networks import write_network

from placefield import Config, ConfigError, Recognizer, build_map
from placefield.config import InferenceConfig
from placefield.evaluation.truth import Truth
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_services.exploring_services import run_exploring_featurizer
from placefield_services.featurizer import run_featurizer
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.build.routes_from_sources import RouteOptions, build_routes
from placefield_tools.evaluate.evaluation import evaluate
from placefield_tools.evaluate.query import Query
from placefield_tools.explore.explored_map import AskedMap
from placefield_tools.explore.exploring_host import check_explored
from placefield_tools.loops.finding import find_loops
from placefield_tools.sources import NO_PARTS, open_source
from placefield_tools.study.run_study import prepare


def no_truth(*_: int) -> Truth:
    raise AssertionError("no frame can be described")


def described_by(frames: str, path: Path, config: Config) -> list[Callable[[], object]]:
    """Return what describes frames by the network of a configuration or of a map."""
    placemap, stop, query = open_map(path), threading.Event(), Query(frames)
    stop.set()
    return [
        lambda: build_from([frames], config),
        lambda: build_routes([frames], config, NO_PARTS, RouteOptions()),
        lambda: build_map(sorted(Path(frames).iterdir()), config=config),
        lambda: evaluate(path, query, no_truth, config, services=False),
        lambda: check_explored(AskedMap(path.with_name("new.pfmap"), config)),
        lambda: run_exploring_featurizer(config, None, stop),
        lambda: run_featurizer(placemap, config, stop),
        lambda: find_loops(open_source((frames,)), frames, config),
        lambda: Recognizer(placemap, config),
        lambda: prepare(frames, query, no_truth, config, words=False),
    ]


def test_a_provider_that_is_missing_is_refused_wherever_frames_are_described(
    reference_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_network(tmp_path / "net.onnx")
    features = {"kind": f"onnx:{tmp_path / 'net.onnx'}"}
    config = Config.model_validate({"features": features, "scales": {"channels": 1}})
    save_map(build_from([str(reference_dir)], config), tmp_path / "route.pfmap")
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    elsewhere = config.model_copy(update={"inference": InferenceConfig(provider="cuda")})
    for describe in described_by(str(reference_dir), tmp_path / "route.pfmap", elsewhere):
        with pytest.raises(ConfigError, match=r"^setting inference\.provider: cuda is not avail"):
            describe()
