"""Matches are verified by geometry where the map keeps local features."""

import json
from pathlib import Path

from typer.testing import CliRunner

from placefield_tools.cli.main import app


def test_evaluate_reports_verified_matches_of_a_map_with_local_features(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    flags = ["--aligned", "--json", "-o", str(tmp_path), "--channels", "1", "--metric", "identity"]
    command = ["evaluate", str(reference_dir), str(query_dir), *flags]
    found = CliRunner().invoke(app, [*command, "--set", "build.local_features=100"])
    assert found.exit_code == 0, found.output
    rules = json.loads(found.stdout)["rules"]
    of_filter = rules["filter"]
    assert "verified" not in rules["evidence"]
    before, after = of_filter["lag"]["20"], of_filter["verified"]
    assert after["known"]["precision"] == 1
    assert after["known"]["count"] >= before["known"]["count"]
    assert after["mean_lag"] == before["mean_lag"]
