"""A real network on the hardest of the real routes, as the documentation says to use it."""

import re
import tomllib
from pathlib import Path
from shutil import copy

import pytest

from placefield.config import Config
from placefield.evaluation.truth import Truth
from placefield.features.network import NetworkInput
from placefield_tools.build.map_from_sources import map_of
from placefield_tools.evaluate.evaluation import evaluate
from placefield_tools.evaluate.query import Query

PAGE = Path(__file__).resolve().parents[2] / "docs" / "accuracy.md"


@pytest.fixture
def tomls() -> list[str]:
    """The examples in the documentation of what lies beside a network."""
    return re.findall(r"```toml\n(# \w+\.toml.*?)```", PAGE.read_text(), re.DOTALL)


def test_the_examples_of_the_documentation_are_valid(tomls: list[str]) -> None:
    assert len(tomls) == 2
    for toml in tomls:
        NetworkInput.model_validate(tomllib.loads(toml))


def test_mobilenet_recognises_by_night_what_it_saw_by_day_from_the_other_side(
    data_dir: Path, models_dir: Path, tomls: list[str], tmp_path: Path
) -> None:
    network = tmp_path / "mobilenet.onnx"
    copy(models_dir / "mobilenet_v2_imagenet.onnx", network)
    network.with_suffix(".toml").write_text(next(t for t in tomls if "mobilenet" in t))
    route = data_dir / "gardens_point"
    config = Config.model_validate(
        {"features": {"kind": f"onnx:{network}"}, "metric": {"kind": "identity"}}
    )

    def truth_of(queries: int, places: int) -> Truth:
        return Truth.within(queries, places, 3)

    with map_of(str(route / "day_left"), config, feature_asked=True) as map_path:
        evaluation = evaluate(
            map_path, Query(str(route / "night_right")), truth_of, config, services=False
        )
    curve = evaluation.results["evidence"].curve
    assert curve.recall_at_100_precision >= 0.97
