"""Matches are verified by geometry where the map keeps local features."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from local_networks import PATCH, write_corner_network
from typer.testing import CliRunner

from placefield.config import Config
from placefield.errors import ConfigError
from placefield.features.frames import Frame
from placefield.fusion.match import Match
from placefield.maps.opening import open_map
from placefield.verification.verification_stage import VerificationStage
from placefield_tools.cli.main import app

pytestmark = pytest.mark.usefixtures("no_plots")

QUICK = ["--channels", "1", "--metric", "identity", "--set", "build.local_features=100"]


def run(*command: object) -> str:
    found = CliRunner().invoke(app, list(map(str, command)))
    assert found.exit_code == 0, found.output
    return found.stdout


def test_evaluate_reports_verified_matches_of_a_map_with_local_features(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    flags = ["--aligned", "--json", "-o", tmp_path, *QUICK]
    rules = json.loads(run("evaluate", reference_dir, query_dir, *flags))["rules"]
    of_filter = rules["filter"]
    assert "verified" not in rules["evidence"]
    before, after = of_filter["lag"]["20"], of_filter["verified"]
    assert after["known"]["precision"] == 1
    assert after["known"]["count"] >= before["known"]["count"]
    assert after["mean_lag"] == before["mean_lag"]


def test_a_map_keeps_the_network_of_its_local_features_and_frames_are_described_by_it(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    network, path = tmp_path / "corners.onnx", tmp_path / "route.pfmap"
    write_corner_network(network)
    local = ["--set", f"build.local_feature=onnx:{network}"]
    run("build", reference_dir, "-o", path, *QUICK, *local)
    network.unlink()

    opened = open_map(path)
    places = opened.local_features
    assert places is not None
    assert places.descriptors.shape[1] == PATCH**2
    stage = VerificationStage(opened, Config())
    image = sorted(reference_dir.glob("*.jpg"))[3].read_bytes()
    for given, kept in zip(stage.extract(Frame(3, 0, "", image)), places.of(3), strict=True):
        np.testing.assert_array_equal(given, kept)
    seen = sorted(query_dir.glob("*.jpg"))[3].read_bytes()
    assert stage.inliers(Match(3, 0.0), stage.extract(Frame(3, 0, "", seen))) > 20

    flags = ["--aligned", "--json", "-o", tmp_path / "report"]
    of_filter = json.loads(run("evaluate", path, query_dir, *flags))["rules"]["filter"]
    before, after = of_filter["lag"]["20"]["known"], of_filter["verified"]["known"]
    assert after["precision"] == 1
    assert after["count"] >= before["count"]

    run("add", path, query_dir)
    added = open_map(path).local_features
    assert added is not None
    np.testing.assert_array_equal(added.onnx, places.onnx)

    narrow = replace(places, descriptors=places.descriptors[:, 1:])
    with pytest.raises(ConfigError, match=r"gives descriptors of 49 numbers, and those of .* 48"):
        VerificationStage(replace(opened, local_features=narrow), Config())


def test_a_network_of_local_features_without_their_number_is_refused(
    reference_dir: Path, tmp_path: Path
) -> None:
    command = ["build", str(reference_dir), "-o", str(tmp_path / "route.pfmap"), "--set"]
    for setting, reason in (
        ("onnx:net.onnx", "setting build.local_feature: also give build.local_features"),
        ("orb", "give sift, or onnx:FILE"),
    ):
        refused = CliRunner().invoke(app, [*command, f"build.local_feature={setting}"])
        assert isinstance(refused.exception, ConfigError)
        assert reason in str(refused.exception)
