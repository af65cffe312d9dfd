"""The command line in this process; commands that run until they are stopped are system tests."""

import json
import tomllib
from importlib.metadata import version
from pathlib import Path
from shutil import copytree
from typing import get_args

import cv2
import pytest
from command_lines import Run
from frame_folders import first_frames, uneven_drive

from placefield.config import Config, Rule

RULES = get_args(Rule)


def is_picture(path: Path) -> bool:
    return cv2.imread(str(path)) is not None


def test_it_reports_its_version(placefield: Run) -> None:
    ended = placefield("--version")
    assert (ended.code, ended.out) == (0, f"placefield {version('placefield')}\n")


def test_build_inspect_and_evaluate_go_together(
    placefield: Run, reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    flags = ("--channels", "2", "--metric", "identity", "--min-scale", "5", "--seed", "3")
    built = placefield("build", reference_dir, "-o", "maps/route.pfmap", *flags)
    assert built.code == 0, built.err
    assert "60 places, 2 channels" in built.out

    inspected = placefield("inspect", "maps/route.pfmap")
    assert inspected.code == 0, inspected.err
    for fact in (
        "route.pfmap",
        "60, without poses",
        "travelled",
        "gist",
        "identity",
        "channel",
        "scales",
    ):
        assert fact in inspected.out
    assert is_picture(tmp_path / inspected.out.splitlines()[-1])

    evaluated = placefield("evaluate", "maps/route.pfmap", query_dir)
    assert evaluated.code == 0, evaluated.err
    assert all(rule in evaluated.out for rule in RULES)
    assert evaluated.out.splitlines()[0].startswith("57 of 60 frames known, all right; ")
    lines = [line for line in evaluated.out.splitlines() if "calibration error" in line]
    names = [line.partition(":")[0] for line in lines]
    assert names == ["filter", "filter, lag 20", "filter, in hindsight"]
    pictures = [line for line in evaluated.out.splitlines() if line.endswith(".png")]
    assert len(pictures) == 3
    assert all(is_picture(tmp_path / picture) for picture in pictures)


def test_evaluate_prints_one_json_object_and_nothing_else_on_stdout(
    placefield: Run, map_path: Path, query_dir: Path
) -> None:
    evaluated = placefield("evaluate", map_path, query_dir, "--json", "--tolerance", "2")
    assert evaluated.code == 0, evaluated.err
    figures = json.loads(evaluated.out)
    assert set(figures) == {"rules", "frames", "unreadable", "missing", "tolerance", "truth"}
    assert (figures["unreadable"], figures["missing"]) == (0, 0)
    assert (figures["frames"], figures["tolerance"]) == (60, 2)
    assert figures["truth"] == {"by": "aligned"}
    assert set(figures["rules"]) == {*RULES}
    for rule, shares in figures["rules"].items():
        lags = shares.pop("lag")
        assert [*lags] == ["0", "10", "20", "all"]
        untold = dict.fromkeys(("expected_calibration_error", "known", "too_fast"))
        assert lags["0"] == untold | shares | {"mean_lag": 0}
        for at_lag in lags.values():
            assert at_lag.pop("mean_lag") >= 0
            known, error = at_lag.pop("known"), at_lag.pop("expected_calibration_error")
            assert (known is None) == (error is None) == (rule != "filter")
            assert at_lag.pop("too_fast") == (0 if rule == "filter" else None)
            if known is not None:
                assert set(known) == {"count", "precision", "recall"}
                assert 0 <= error <= 1
            assert set(at_lag) == {"auc", "recall_at_100_precision", "recall_at_1"}
            assert all(0 <= value <= 1 for value in at_lag.values())
        certainty = {*untold} if rule == "filter" else set()
        assert set(shares) == {"auc", "recall_at_100_precision", "recall_at_1"} | certainty
    assert figures["rules"]["evidence"]["recall_at_1"] == 1
    assert figures["rules"]["filter"]["recall_at_1"] > 0.9
    assert "describing the query" in evaluated.err


def test_evaluate_builds_the_map_itself_where_it_is_given_frames(
    placefield: Run, map_path: Path, reference_dir: Path, query_dir: Path
) -> None:
    flags = ("--json", "--channels", "3", "--metric", "identity")
    built_now = placefield("evaluate", reference_dir, query_dir, *flags)
    built_before = placefield("evaluate", map_path, query_dir, "--json")
    now, before = json.loads(built_now.out), json.loads(built_before.out)
    # A map built with several BLAS threads differs in the last bits.
    for rules in (now["rules"], before["rules"]):
        for shares in (rules["filter"], *rules["filter"]["lag"].values()):
            shares["expected_calibration_error"] = pytest.approx(
                shares["expected_calibration_error"]
            )
    assert now == before


def test_the_tolerance_may_be_a_setting_like_any_other(
    placefield: Run, map_path: Path, query_dir: Path
) -> None:
    evaluated = placefield(
        "evaluate", map_path, query_dir, "--json", "--set", "matching.tolerance=1"
    )
    assert json.loads(evaluated.out)["tolerance"] == 1


def test_spacing_makes_an_uneven_drive_even(
    placefield: Run, reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    flags = ("--json", "--channels", "2", "--metric", "identity", "-o")
    even = placefield("evaluate", reference_dir, query_dir, *flags, "even")
    drives = [uneven_drive(path, tmp_path / path.name) for path in (reference_dir, query_dir)]
    spaced = placefield("evaluate", *drives, "--spacing", "0.1", *flags, "spaced")
    assert spaced.code == 0, spaced.err
    figures, expected = (json.loads(each.out)["rules"] for each in (spaced, even))
    assert {**figures, "filter": None} == {**expected, "filter": None}
    for key in ("auc", "recall_at_100_precision"):  # odometry makes it surer, and no other
        assert figures["filter"][key] == expected["filter"][key]

    build = ("build", drives[0], "-o", "route.pfmap", "--metric", "identity")
    assert "60 places" in placefield(*build, "--spacing", "0.1").out


def test_a_map_that_is_there_is_overwritten_only_if_reported_to(
    placefield: Run, reference_dir: Path, query_dir: Path, tmp_path: Path
) -> None:
    target = tmp_path / "route.pfmap"
    flags = ("-o", target, "--channels", "1", "--metric", "identity")
    assert placefield("build", reference_dir, *flags).code == 0
    before = (target / "manifest.json").read_bytes()
    refused = placefield("build", query_dir, *flags)
    assert refused.code == 1
    assert "is there already" in refused.err
    assert "--overwrite" in refused.err
    assert (target / "manifest.json").read_bytes() == before
    assert placefield("build", query_dir, *flags, "--overwrite").code == 0
    assert (target / "manifest.json").read_bytes() != before


def test_a_truth_file_decides_what_is_right(
    placefield: Run, map_path: Path, query_dir: Path, tmp_path: Path
) -> None:
    truth = tmp_path / "truth.csv"
    truth.write_text("query,first,last\n" + "".join(f"{q},{q},{q + 1}\n" for q in range(30)))
    evaluated = placefield("evaluate", map_path, query_dir, "--truth", truth, "--json")
    figures = json.loads(evaluated.out)
    assert figures["tolerance"] is None
    assert figures["truth"] == {"by": "given"}
    assert figures["rules"]["filter"]["recall_at_1"] > 0.9


def test_a_path_with_brackets_is_printed_as_it_is(
    placefield: Run, map_path: Path, query_dir: Path, tmp_path: Path
) -> None:
    odd_query, odd_map = tmp_path / "[red]night[/b]", tmp_path / "day[/b].pfmap"
    first_frames(query_dir, 20, odd_query)
    copytree(map_path, odd_map)
    evaluated = placefield("evaluate", odd_map, odd_query, "--aligned", "-o", "[i]pictures")
    assert evaluated.code == 0, evaluated.err
    assert "[i]pictures/matches.png" in evaluated.out
    assert str(odd_query) in "".join(evaluated.out.split())
    assert str(odd_map) in placefield("inspect", odd_map).out


def test_a_query_shorter_than_the_smallest_scale_is_evaluated(
    placefield: Run, map_path: Path, query_dir: Path, tmp_path: Path
) -> None:
    short = first_frames(query_dir, 2, tmp_path / "short")
    evaluated = placefield("evaluate", map_path, short, "--json", "--aligned")
    assert evaluated.code == 0, evaluated.err
    figures = json.loads(evaluated.out)
    assert figures["frames"] == 2
    assert figures["rules"]["ams"]["recall_at_1"] == 0  # it waits for a whole window


def test_config_prints_toml_that_gives_the_same_settings(placefield: Run, tmp_path: Path) -> None:
    printed = placefield("config", "--set", "scales.channels=9", "--set", "runs=night")
    assert printed.code == 0
    file = tmp_path / "run.toml"
    file.write_text(printed.out)
    assert Config.model_validate(tomllib.loads(printed.out)).scales.channels == 9
    assert placefield("config", "--config", file).out == printed.out


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("config", "--set", "scales.chanels=9"), "scales.chanels"),
        (("config", "--set", "scales"), "write it as KEY=VALUE"),
        (("config", "--set", "_cli_parse_args=true"), "write it as KEY=VALUE"),
        (("config", "--config", "no.toml"), "no.toml: no such configuration file"),
        (("build", "{ref}", "-o", "route"), "route: a map's name ends in .pfmap"),
        (("build", "{ref}", "-o", "x.pfmap", "--min-scale", "4ft"), "--min-scale '4ft'"),
        (("build", "{ref}", "-o", "x.pfmap", "--min-scale", "5m"), "has no poses"),
        (("build", "{ref}", "-o", "x.pfmap", "--metric", "cosine"), "metric.kind"),
        (
            ("build", "{ref}", "-o", "x.pfmap", "--feature", "surf"),
            "'surf': give grayscale, gist, descriptor or onnx",
        ),
        (("build", "{ref}", "-o", "x.pfmap", "--feature", "onnx:no.onnx"), "no.onnx: no such"),
        (("build", "{empty}", "-o", "x.pfmap"), "{empty}: no image files"),
        (("build", "no-folder", "-o", "x.pfmap"), "no-folder: no such folder or file"),
        (("build", "{short}", "-o", "x.pfmap"), "frames is too short"),
        (("build", "{damaged}", "-o", "x.pfmap"), "0007.jpg"),
        (("build", "{ref}", "-o", "x.pfmap", "--spacing", "1"), "0000.jpg: has no odometry"),
        (("evaluate", "{map}", "{query}", "--spacing", "1"), "0000.jpg: has no odometry"),
        (("replay", "{query}", "--spacing", "0"), "--spacing 0: must be a distance"),
        (("inspect", "no.pfmap"), "no.pfmap: no map there"),
        (("inspect", "{broken}"), "projection.npy: damaged: its checksum is wrong"),
        (("evaluate", "no.pfmap", "{query}"), "no.pfmap: no map there"),
        (("evaluate", "{broken}", "{query}"), "projection.npy: damaged: its checksum is wrong"),
        (("evaluate", "{map}", "{empty}"), "{empty}: no image files"),
        (("evaluate", "{map}", "{unreadable}"), "no frame that can be read"),
        (("evaluate", "{map}", "{query}", "--feature", "grayscale"), "holds gist features, not"),
        (("evaluate", "{map}", "{query}", "--channels", "2"), "{map} is built already"),
        (("evaluate", "{map}", "{query}", "--truth", "no.csv"), "no.csv"),
        (("evaluate", "{map}", "{query}", "--truth", "{truth}"), "{truth}:3"),
        (
            ("evaluate", "{map}", "{query}", "--truth", "{truth}", "--tolerance", "3"),
            "--tolerance and --truth",
        ),
        (("evaluate", "{map}", "{query}", "-o", "{truth}"), "{truth}"),
        (("channel", "{map}", "--channel", "3"), "--channel 3: the map has channels 0 to 2"),
        (("featurizer", "no.pfmap"), "no.pfmap: no map there"),
        (("verifier", "{map}"), "{map}: has no local features to verify matches with"),
        (("channel", "{broken}", "--channel", "0"), "projection.npy: damaged"),
        (("demo", "{ref}", "{empty}"), "{empty}: no image files"),
    ],
)
def test_what_cannot_go_on_says_why_in_one_line(
    placefield: Run, bad_input: dict[str, Path], arguments: tuple[str, ...], reason: str
) -> None:
    names = {name: str(path) for name, path in bad_input.items()}
    ended = placefield(*(argument.format(**names) for argument in arguments))
    assert reason.format(**names) in ended.refusal


@pytest.fixture
def bad_input(
    tmp_path: Path, reference_dir: Path, query_dir: Path, map_path: Path
) -> dict[str, Path]:
    """What is wrong in one way each, by name, and what is right."""
    paths = {"ref": reference_dir, "query": query_dir, "map": map_path}
    names = ("empty", "short", "damaged", "unreadable", "broken.pfmap", "truth.csv")
    paths |= {name.partition(".")[0]: tmp_path / name for name in names}
    paths["empty"].mkdir()
    first_frames(reference_dir, 10, paths["short"])
    first_frames(reference_dir, 20, paths["damaged"])
    cut = paths["damaged"] / "0007.jpg"
    cut.write_bytes(cut.read_bytes()[:-100])
    paths["unreadable"].mkdir()
    (paths["unreadable"] / "0.jpg").write_bytes(b"no image")
    copytree(map_path, paths["broken"])
    projection = paths["broken"] / "metrics" / "0" / "projection.npy"
    projection.write_bytes(projection.read_bytes()[:-1] + b"\x55")
    paths["truth"].write_text("query,first,last\n0,0,1\n1,two,3\n")
    return paths


@pytest.mark.parametrize(
    "arguments",
    [
        ("evaluate",),
        ("no-such-command",),
        ("build", "ref"),
        ("channel", "x.pfmap"),
        ("up", "x.pfmap", "--workers", "0"),
        ("replay", "x", "--rate", "0"),
    ],
)
def test_a_command_line_that_is_wrong_is_answered_with_its_usage(
    placefield: Run, arguments: tuple[str, ...]
) -> None:
    ended = placefield(*arguments)
    assert ended.code == 2
    assert "Usage" in ended.err
    assert not ended.out
    assert "Traceback" not in ended.err


COMMANDS = ["build", "inspect", "evaluate", "study", "demo", "config"]
COMMANDS += ["up", "featurizer", "describer", "channel", "fuser", "verifier", "replay", "listen"]
COMMANDS += ["status"]
COMMANDS += ["serve", "fetch", "router", "alive", "plan", "chaos", "bench", "security"]
COMMANDS += ["ros", "record", "export", "loops", "dashboard", "datasets", "doctor"]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(placefield: Run, command: str) -> None:
    helped = placefield(command, "--help")
    assert helped.code == 0
    assert f"Usage: placefield {command}" in helped.out
    assert command in placefield("--help").out
