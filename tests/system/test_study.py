"""``placefield study`` and the protocols of ``evaluate``, as a person runs them."""

import json
import re
from pathlib import Path
from typing import Any, get_args

import pytest
from typer.testing import CliRunner, Result

from placefield.evaluation.protocols import THINS_REFERENCE, Protocol
from placefield_tools.cli.main import app
from placefield_tools.study import describing, report
from placefield_tools.study.paper import channel_count_runs as channel_counts

PROTOCOLS: tuple[Protocol, ...] = get_args(Protocol)
FIGURES = {
    "auc",
    "recall_at_100_precision",
    "recall_at_1",
    "auc_of_correct",
    "recall_at_100_precision_of_correct",
}


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(describing, "WORDS", 100)
    monkeypatch.setattr(channel_counts, "MOST_COMBINATIONS", 2)
    monkeypatch.chdir(tmp_path)


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def flags_of(protocol: Protocol, other: Path) -> list[str]:
    flags = ["--protocol", protocol, "--channels", "2"]
    flags += ["--every=2"] if protocol == "sparse" else []
    return [*flags, "--other", str(other)] if protocol == "off-route" else flags


def study_of(
    reference_dir: Path, query_dir: Path, folder: Path, *flags: str | Path
) -> dict[str, Any]:
    """Return the figures of a study, without its report, which takes long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, "write_report", lambda folder, study: folder)
        patch.setattr(describing, "WORDS", 100)
        ended = run("study", reference_dir, query_dir, "--json", "-o", folder, *flags)
    assert ended.exit_code == 0, ended.exception
    figures: dict[str, Any] = json.loads(ended.stdout)
    return figures


@pytest.fixture(scope="module")
def dense(
    reference_dir: Path, query_dir: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Any]:
    """The figures of a study of a thinned reference."""
    folder = tmp_path_factory.mktemp("dense")
    return study_of(reference_dir, query_dir, folder, *flags_of("dense", query_dir))


def assert_all_is_there(study: dict[str, Any], *, cannot: set[str]) -> None:
    """All methods but those that cannot have figures that are possible, and so have the parts."""
    methods = {method["name"]: method for method in study["methods"]}
    assert {"one frame", "SeqSLAM", "FAB-MAP", "MS", "Placefield, filter, lag 20"} < {*methods}
    failed = {name for name, method in methods.items() if "failure" in method}
    assert failed <= cannot
    for method in (methods[name] for name in {*methods} - failed):
        assert all(0 <= method[figure] <= 1 + 1e-9 for figure in FIGURES)
        published = method["name"] in ("MS", "AMS as published")
        assert method["lag"] == (1000 if published else 20 if "lag 20" in method["name"] else 0)
        assert 0 <= method["mean_lag"] <= method["lag"]
        assert method["frames_to_recover"] is None  # there is no kidnapping
        assert (method["frames_on_route"] < method["frames"]) == (study["protocol"] == "off-route")
    assert methods["Placefield, filter"]["recall_at_1"] > 0.7
    assert len(study["ablation"]) == 16  # of one traverse no metric is learned, to leave out
    for part in study["ablation"]:
        assert part["lag"] in (0, 20)
        assert 0 <= part["mean_lag"] <= part["lag"]
        assert ("known" in part) == (part["rule"] == "filter")


def test_a_study_of_a_thinned_reference_has_every_method_and_part(dense: dict[str, Any]) -> None:
    assert (dense["protocol"], dense["every"], dense["tolerance"]) == ("dense", 3, 3)
    assert dense["places"] == 20
    assert_all_is_there(dense, cannot={"AMS as published"})  # of 20 places


def test_a_study_of_a_vehicle_off_the_route_has_every_method_and_part(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    study = study_of(reference_dir, query_dir, tmp_path, *flags_of("off-route", query_dir))
    assert (study["protocol"], study["every"], study["tolerance"]) == ("off-route", None, 3)
    assert study["places"] == 60
    assert_all_is_there(study, cannot=set())


def test_the_table_names_the_conventions_and_the_oracle(
    reference_dir: Path, query_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    flags = flags_of("kidnap", query_dir)
    ended = run("study", reference_dir, query_dir, *flags, "-o", "[b]out")
    assert ended.exit_code == 0, ended.exception
    for text in (
        "recall at 100 % precision",
        "recall@1",
        "VPR-Bench AUC",
        "mean lag",
        "frames to recover",
    ):
        assert text in ended.stdout
    lines = [line for line in ended.stdout.splitlines() if "window of" in line]
    best = [line for line in lines if re.search(r" \* +│", line)]
    assert len(best) == 2
    assert sum("lag 20" in line for line in best) == 1
    assert "[b]out/report.html" in ended.stdout
    assert (tmp_path / "[b]out" / "report.html").is_file()


@pytest.mark.parametrize("protocol", [p for p in PROTOCOLS if p not in THINS_REFERENCE])
def test_evaluate_drives_by_every_protocol_that_leaves_the_map_as_it_is(
    map_path: Path, reference_dir: Path, query_dir: Path, protocol: Protocol
) -> None:
    flags = [flag for flag in flags_of(protocol, reference_dir) if flag not in ("--channels", "2")]
    ended = run("evaluate", map_path, query_dir, "--json", *flags)
    assert ended.exit_code == 0, ended.exception
    figures = json.loads(ended.stdout)
    assert figures["rules"]["filter"]["recall_at_1"] > 0.7


@pytest.mark.parametrize("command", ["evaluate", "study"])
@pytest.mark.parametrize(
    ("flags", "reason"),
    [
        (["--protocol", "off-route"], "--protocol off-route: give the other route's frames"),
        (["--every", "2"], "--every 2: only --protocol speed, odometry, dense and sparse"),
        (["--other", "elsewhere"], "--other elsewhere: only --protocol off-route"),
        (["--truth", "truth.csv", "--tolerance", "3"], "--tolerance and --truth"),
    ],
)
def test_what_does_not_go_together_is_refused(
    reference_dir: Path, query_dir: Path, command: str, flags: list[str], reason: str
) -> None:
    ended = run(command, reference_dir, query_dir, *flags)
    assert str(ended.exception).startswith(reason)


@pytest.mark.parametrize("protocol", THINS_REFERENCE)
def test_evaluate_says_who_thins_a_reference(
    map_path: Path, query_dir: Path, protocol: Protocol
) -> None:
    reason = str(run("evaluate", map_path, query_dir, "--protocol", protocol).exception)
    assert f"placefield study REFERENCE QUERY --protocol {protocol}" in reason
    assert "\n" not in reason


def test_a_truth_file_keeps_the_numbers_of_all_frames_where_the_reference_is_thinned(
    reference_dir: Path, query_dir: Path, tmp_path: Path, dense: dict[str, Any]
) -> None:
    truth = tmp_path / "truth.csv"
    rows = [f"{i},{max(i - 9, 0)},{min(i + 9, 59)}" for i in range(60)]
    truth.write_text("\n".join(["query,first,last", *rows]))
    flags = (*flags_of("dense", query_dir), "--truth", truth)
    by_file = study_of(reference_dir, query_dir, tmp_path, *flags)
    for one, other in zip(by_file["methods"], dense["methods"], strict=True):
        assert [one.get(f) for f in FIGURES] == [other.get(f) for f in FIGURES]


def test_a_study_of_a_map_is_refused(map_path: Path, query_dir: Path) -> None:
    assert "a map has no frames" in str(run("study", map_path, query_dir).exception)


@pytest.mark.parametrize("setting", ["scales.channels=2", "metric.kind=rca", "features.kind=gist"])
def test_settings_of_a_map_are_refused_where_it_is_built_already(
    map_path: Path, query_dir: Path, setting: str
) -> None:
    ended = run("evaluate", map_path, query_dir, "--set", setting)
    assert "is built already" in str(ended.exception)


def test_a_study_by_the_preset_is_the_papers_on_the_feature_that_is_asked_for(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    flags = ["--preset", "paper", "--channels", "2", "--feature", "gist", "-o", "one"]
    ended = run("study", reference_dir, query_dir, *flags, "--json")
    assert ended.exit_code == 0, ended.exception
    study = json.loads(ended.stdout)
    assert study["preset"] == "paper"
    assert [one["feature"] for one in study["features"]] == ["gist"]
    assert (tmp_path / "one" / "report.html").is_file()


@pytest.mark.parametrize("command", ["evaluate", "up"])
def test_a_preset_is_refused_on_a_map_that_was_built_without_it(
    map_path: Path, query_dir: Path, command: str
) -> None:
    sources = [map_path, query_dir] if command == "evaluate" else [map_path]
    reason = str(run(command, *sources, "--preset", "paper").exception)
    assert "was built without it" in reason
    assert "placefield build --preset paper" in reason
