"""What ``evaluate`` and ``study`` take for the truth, from folders of frames to figures."""

import json
from collections.abc import Callable
from pathlib import Path
from shutil import copy
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from placefield.errors import ConfigError, TruthError
from placefield.maps.geography import Origin
from placefield_tools.cli.main import app
from placefield_tools.study import report

HERE = Origin(48.0, 11.0)
FLAGS = ("--json", "--channels", "2", "--metric", "identity")
COUNT = 60

Row = Callable[[int], str]


def on_earth(number: int) -> str:
    latitude, longitude = HERE.to_degrees(2.0 * number, 0.5 * number)
    return f"{latitude:.9f},{longitude:.9f}"


def in_metres(number: int) -> str:
    return f"{2.0 * number},0"


def drive(
    source: Path, target: Path, numbers: list[int], header: str, row: Row, *, without: int = 0
) -> Path:
    """Frames of these numbers, each where it was taken; the first ``without`` do not know where."""
    target.mkdir()
    files = sorted(source.iterdir())
    lines = [f"file,{header}"]
    for at, number in enumerate(numbers):
        copy(files[number], target / f"{at:03}{files[number].suffix}")
        where = "," * row(number).count(",") if at < without else row(number)
        lines.append(f"{at:03}{files[number].suffix},{where}")
    (target / "frames.csv").write_text("\n".join(lines))
    return target


def reported(*arguments: str | Path) -> dict[str, Any]:
    ended = CliRunner().invoke(app, [str(each) for each in arguments])
    if ended.exception is not None and not isinstance(ended.exception, SystemExit):
        raise ended.exception
    assert ended.exit_code == 0, ended.output
    return dict(json.loads(ended.stdout))


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("no_plots")
@pytest.mark.parametrize(
    ("tolerance", "numbers"),
    [
        ((), [*range(0, COUNT, 2)]),
        (("--tolerance", "5m"), [*range(0, COUNT, 2)]),
        (("--tolerance", "2"), [*range(20, 60)]),
    ],
)
def test_georeferenced_positions_of_both_sides_are_the_truth_whatever_the_spacing(
    reference_dir: Path,
    query_dir: Path,
    tmp_path: Path,
    tolerance: tuple[str, ...],
    numbers: list[int],
) -> None:
    reference = drive(
        reference_dir, tmp_path / "r", [*range(COUNT)], "latitude,longitude", on_earth
    )
    query = drive(query_dir, tmp_path / "q", numbers, "latitude,longitude", on_earth)
    figures = reported("evaluate", reference, query, *FLAGS, *tolerance)
    metres = 5.0 if "5m" in tolerance else None
    assert figures["truth"] == {"by": "poses", "metres": metres, "unjudged": 0}
    assert figures["rules"]["evidence"]["recall_at_1"] > 0.8
    known = figures["rules"]["filter"]["lag"]["20"]["known"]
    assert known["count"] > 0
    assert known["precision"] > 0.95


def test_frames_whose_position_nobody_knows_are_not_judged(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    everything = [*range(COUNT)]
    reference = drive(reference_dir, tmp_path / "r", everything, "latitude,longitude", on_earth)
    query = drive(query_dir, tmp_path / "q", everything, "latitude,longitude", on_earth, without=10)
    figures = reported("evaluate", reference, query, *FLAGS)
    assert figures["truth"]["unjudged"] == 10
    assert figures["rules"]["evidence"]["recall_at_1"] > 0.8


@pytest.mark.parametrize("command", ["evaluate", "study"])
def test_where_counts_differ_and_nothing_reports_there_is_no_verdict_but_what_is_known(
    reference_dir: Path, query_dir: Path, tmp_path: Path, command: str
) -> None:
    query = drive(query_dir, tmp_path / "q", [*range(50)], "stamp", lambda number: f"{number}")
    arguments = (command, reference_dir, query, *FLAGS)
    if command == "study":
        with pytest.raises(TruthError, match=r"50 frames, and the reference 60; .*--aligned"):
            reported(*arguments)
        return
    figures = reported(*arguments)
    assert figures["truth"]["by"] == "none"
    assert "the query has 50 frames, and the reference 60" in figures["truth"]["why"]
    assert [*figures["rules"]] == ["filter"]
    assert figures["rules"]["filter"].keys() == {"known"}
    known = figures["rules"]["filter"]["known"]
    assert known["share"] == pytest.approx(known["count"] / 50)
    said = CliRunner().invoke(app, [str(each) for each in arguments if each != "--json"])
    assert "NO VERDICT" in said.stdout
    assert "recall" not in said.stdout
    aligned = reported(*arguments, "--aligned")
    assert aligned["truth"] == {"by": "aligned"}
    assert aligned["rules"]["evidence"]["recall_at_1"] > 0.8


def test_as_many_frames_on_another_way_are_no_truth(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    everything = [*range(COUNT)]
    reference = drive(reference_dir, tmp_path / "r", everything, "odometry", lambda at: f"{at}")
    query = drive(query_dir, tmp_path / "q", everything, "odometry", lambda at: f"{at / 2}")
    figures = reported("evaluate", reference, query, *FLAGS)
    assert "the query is 30 m long, and the reference 59 m" in figures["truth"]["why"]


@pytest.mark.usefixtures("no_plots")
def test_metres_of_one_s_own_are_compared_only_if_somebody_says_that_they_are_the_same(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    reference = drive(reference_dir, tmp_path / "r", [*range(COUNT)], "x,y", in_metres)
    query = drive(query_dir, tmp_path / "q", [*range(0, COUNT, 2)], "x,y", in_metres)
    arguments = ("evaluate", reference, query, *FLAGS)
    assert reported(*arguments)["truth"]["by"] == "none"
    with pytest.raises(TruthError, match=r"--tolerance 5m: .*--same-frame"):
        reported(*arguments, "--tolerance", "5m")
    figures = reported(*arguments, "--same-frame", "--tolerance", "5m")
    assert figures["truth"]["by"] == "poses"
    assert figures["rules"]["evidence"]["recall_at_1"] > 0.8


@pytest.mark.parametrize("flag", [("--tolerance", "5m"), ("--same-frame",)])
def test_what_needs_poses_on_both_sides_says_which_has_none(
    reference_dir: Path, query_dir: Path, tmp_path: Path, flag: tuple[str, ...]
) -> None:
    query = drive(query_dir, tmp_path / "q", [*range(COUNT)], "x,y", in_metres)
    with pytest.raises(TruthError, match=f"^{' '.join(flag)}: .* the reference has none$"):
        reported("evaluate", reference_dir, query, *FLAGS, *flag)


@pytest.mark.parametrize("flag", [("--tolerance", "5m"), ("--same-frame",)])
def test_poses_georeferenced_and_in_metres_are_not_compared(
    reference_dir: Path, query_dir: Path, tmp_path: Path, flag: tuple[str, ...]
) -> None:
    everything = [*range(COUNT)]
    reference = drive(reference_dir, tmp_path / "r", everything, "latitude,longitude", on_earth)
    query = drive(query_dir, tmp_path / "q", everything, "x,y", in_metres)
    with pytest.raises(TruthError, match="only the poses of one side are georeferenced"):
        reported("evaluate", reference, query, *FLAGS, *flag)


@pytest.mark.parametrize(
    ("flags", "reason"),
    [
        (("--tolerance", "five"), "write places as 3, or metres as 5m"),
        (("--tolerance", "-1"), "write places as 3"),
        (("--aligned", "--same-frame"), "--aligned and --same-frame"),
        (("--aligned", "--truth", "t.csv"), "--truth and --aligned"),
        (("--aligned", "--tolerance", "5m"), "--aligned: needs --tolerance in places"),
    ],
)
@pytest.mark.parametrize("command", ["evaluate", "study"])
def test_two_answers_to_what_is_right_are_refused(
    reference_dir: Path, query_dir: Path, command: str, flags: tuple[str, ...], reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason):
        reported(command, reference_dir, query_dir, *flags)


def test_a_study_goes_by_georeferenced_positions_too(
    reference_dir: Path, query_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "write_report", lambda folder, study: folder)
    reference = drive(
        reference_dir, tmp_path / "r", [*range(COUNT)], "latitude,longitude", on_earth
    )
    query = drive(query_dir, tmp_path / "q", [*range(0, COUNT, 2)], "latitude,longitude", on_earth)
    study = reported("study", reference, query, *FLAGS, "--tolerance", "5m")
    assert study["truth"] == {"by": "poses", "metres": 5.0, "unjudged": 0}
    methods = {method["name"]: method for method in study["methods"]}
    assert methods["Placefield, filter, lag 20"]["recall_at_1"] > 0.9


@pytest.mark.usefixtures("no_plots")
def test_maps_of_other_origins_are_compared_georeferenced(
    reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    """The query begins elsewhere, so that its metres count from another origin."""
    reference = drive(
        reference_dir, tmp_path / "r", [*range(COUNT)], "latitude,longitude", on_earth
    )
    numbers = [*range(15, 55)]
    query = drive(query_dir, tmp_path / "q", numbers, "latitude,longitude", on_earth)
    figures = reported("evaluate", reference, query, *FLAGS, "--tolerance", "1m")
    truth = tmp_path / "t.csv"
    truth.write_text(
        "query,first,last\n" + "".join(f"{at},{n},{n}\n" for at, n in enumerate(numbers))
    )
    by_file = reported("evaluate", reference, query, *FLAGS, "--truth", truth)
    for rule, shares in figures["rules"].items():
        assert shares == by_file["rules"][rule]
    assert np.isfinite(figures["rules"]["filter"]["auc"])
