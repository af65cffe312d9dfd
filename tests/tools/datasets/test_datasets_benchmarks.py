"""The registry of benchmarks, and what commands print of it."""

from pathlib import Path
from shlex import split

import pytest
from pydantic import ValidationError
from typer.main import get_command
from typer.testing import CliRunner

from placefield.errors import ConfigError, SourceError
from placefield_tools.cli.main import app
from placefield_tools.datasets.benchmarks import Benchmark, benchmark, benchmarks
from placefield_tools.datasets.checking import check
from placefield_tools.datasets.showing import study_command

ALL = list(benchmarks().values())


def run(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["datasets", *arguments], catch_exceptions=False)
    assert result.exit_code == 0
    return result.output


@pytest.mark.parametrize("known", ALL, ids=lambda known: known.name)
def test_an_entry_says_where_it_comes_from_and_what_it_is(known: Benchmark) -> None:
    assert known.page.startswith("https://")
    assert known.traverses
    assert known.study or known.notes
    if known.files:
        assert str(known.files_at).startswith("https://")
        assert str(known.files_at).endswith("/")
    paths = [traverse.folder for traverse in known.traverses] + [file.name for file in known.files]
    assert len(set(paths)) == len(paths)
    assert not any(path.startswith("/") or ".." in path for path in paths)
    assert "\n" not in repr(known.model_dump())


def test_the_corridor_has_a_sum_for_every_frame() -> None:
    known = benchmark("corridor")
    frames = sum(traverse.frames or 0 for traverse in known.traverses)
    assert len({file.sha256 for file in known.files}) == len(known.files) == frames == 222


def test_an_entry_that_does_not_fit_together_is_refused() -> None:
    entry = benchmark("gardens-point").model_dump()
    for changes in (
        {"by_hand": "ask"},
        {"files": ()},
        {"files_at": None},
        {"size": 3},
        {"colour": "red"},
        {"study": {"reference": "day_left", "query": "dawn"}},
        {"files": [{"name": "a.zip", "sha256": "12"}]},
    ):
        with pytest.raises(ValidationError):
            Benchmark.model_validate(entry | changes)
    entry = benchmark("st-lucia").model_dump()
    assert Benchmark.model_validate(entry) == benchmark("st-lucia")
    for changes in (
        {"truth_matrix": "GT.npz"},
        {"study": None},
        {"study": entry["study"] | {"tolerance": 0}},
        {"truth_gps": {"file": "fGPS.txt", "metres": 0}},
    ):
        with pytest.raises(ValidationError):
            Benchmark.model_validate(entry | changes)


def test_an_unknown_name_is_reported_with_one_that_is_close() -> None:
    with pytest.raises(ConfigError, match="did you mean gardens-point"):
        benchmark("garden-point")
    with pytest.raises(ConfigError, match="'placefield datasets' lists the names"):
        benchmark("xyz")


def test_the_list_has_every_name() -> None:
    listed = run()
    assert all(known.name in listed for known in ALL)


@pytest.mark.parametrize("known", ALL, ids=lambda known: known.name)
def test_showing_one_reports_all_that_is_known(known: Benchmark) -> None:
    shown = run("show", known.name)
    reported = (known.title, known.licence, known.page, known.tolerance, known.truth, known.notes)
    assert all(text in shown for text in reported)
    assert (known.by_hand or f"placefield datasets get {known.name}") in shown


def test_the_command_that_runs_one_is_a_command() -> None:
    known_commands = get_command(app)
    for known in ALL:
        if command := study_command(known, Path("my sets") / known.name):
            placefield, *arguments = split(command)
            assert placefield == "placefield"
            study = known_commands.commands[arguments.pop(0)]  # type: ignore[attr-defined]
            given = study.make_context("study", arguments).params
            assert given["reference"].startswith(f"my sets/{known.name}/")
            tolerance = known.study.tolerance  # type: ignore[union-attr]
            assert given["tolerance"] == (None if tolerance is None else str(tolerance))
            has_file = known.truth_matrix is not None or known.truth_gps is not None
            assert (given["truth"] is not None) == has_file


def test_checking_counts_frames_and_reports_all_that_is_wrong(tmp_path: Path) -> None:
    known = benchmark("sfu-mountain")
    for name in ("dry", "jan"):
        (tmp_path / name).mkdir()
    for number in range(385):
        (tmp_path / "dry" / f"{number}.jpg").touch()
    (tmp_path / "jan" / "0.JPG").touch()
    (tmp_path / "jan" / "._0.jpg").touch()
    (tmp_path / "jan" / "notes.txt").touch()
    with pytest.raises(
        SourceError, match=r"1 frames in jan, and 385 are expected; no ground truth truth.csv; see"
    ):
        check(known, tmp_path)
    (tmp_path / "truth.csv").touch()
    for number in range(385):
        (tmp_path / "jan" / f"{number}.JPG").touch()
    reported = run("check", known.name, str(tmp_path))
    assert f"{tmp_path}: dry 385, jan 385\n" in reported
    assert f"--truth {tmp_path}/truth.csv" in reported


def test_a_film_is_there_or_is_not(tmp_path: Path) -> None:
    known = benchmark("st-lucia")
    (tmp_path / "100909_0845").mkdir()
    (tmp_path / "100909_0845" / "webcam_video.avi").touch()
    with pytest.raises(
        SourceError, match=r"as st-lucia: no frames in 180809_1545/webcam_video.avi"
    ):
        check(known, tmp_path)


def test_getting_one_prints_its_licence_and_how_to_run_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def made(known: Benchmark, into: Path, _: object) -> Path:
        for traverse in known.traverses:
            (into / known.name / traverse.folder).mkdir(parents=True)
            for number in range(traverse.frames or 1):
                (into / known.name / traverse.folder / f"{number}.jpg").touch()
        return into / known.name

    monkeypatch.setattr("placefield_tools.datasets.getting.get", made)
    reported = run("get", "gardens-point", "--into", str(tmp_path))
    assert "day_left 200, day_right 200, night_right 200" in reported
    assert benchmark("gardens-point").licence in reported
    assert "gardens-point.sha256" in reported
    assert "placefield study" in reported
