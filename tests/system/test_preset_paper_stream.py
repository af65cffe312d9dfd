"""The preset ``paper`` over the services: what the library says of the same frames, exactly."""

import json
import re
import signal
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hosting import Host, Process, placefield, refusal, wait_until

from placefield.bus.messages import SmoothedMessage
from placefield.library import build_map
from placefield.loading import load_config
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.presets import PRESETS
from placefield.recognizer import Recognizer

PAPER = load_config(None, {"preset": "paper"})
SETTINGS = ("--preset", "paper", "--channels", "3", "--set", "features.dimensions=16")

SmoothedAnswer = tuple[int, int, float, int, tuple[int, ...]]
"""Frame, place, score, lag and missing channels of a smoothed match."""


@pytest.fixture(scope="module")
def paper_path(tmp_path_factory: pytest.TempPathFactory, reference_dir: Path) -> Path:
    """A map of the preset, as a person builds it."""
    path = tmp_path_factory.mktemp("paper") / "paper.pfmap"
    built = placefield("build", reference_dir, *SETTINGS, "-o", path)
    assert built.returncode == 0, built.stderr
    assert built.stdout.startswith(f"{path}: 60 places, 3 channels\ndescriptors keep ")
    return path


@pytest.fixture(scope="module")
def paper_map(paper_path: Path) -> Map:
    return open_map(paper_path)


@pytest.fixture(scope="module")
def paper_host(logs: Path, paper_path: Path) -> Iterator[Host]:
    with Host(logs, paper_path, "--preset", "paper", "--workers", "2") as host:
        yield host


def smoothed_answers(smoothed: list[tuple[int, SmoothedMessage]]) -> list[SmoothedAnswer]:
    return [(n, each.place, each.score, each.lag, each.missing) for n, each in smoothed]


def smoothed_offline(placemap: Map, folder: Path) -> list[SmoothedAnswer]:
    recognizer = Recognizer(placemap, PAPER)
    for file in sorted(folder.iterdir()):
        recognizer.update(file.read_bytes())
    smoothed = recognizer.smoothed() + recognizer.finish()
    return [
        (each.frame, each.match.place, each.match.score, each.lag, each.match.missing)
        for each in smoothed
    ]


@pytest.mark.parametrize("query", ["query_dir", "damaged_dir"])
def test_smoothed_matches_are_the_librarys_to_the_last_bit(
    query: str, request: pytest.FixtureRequest, paper_host: Host, paper_map: Map
) -> None:
    folder: Path = request.getfixturevalue(query)
    with paper_host.listener() as listener:
        paper_host.replay(folder)
        answers = listener.answers()
        smoothed = smoothed_answers(listener.smoothed(answers[0][0].stream))
    assert smoothed == smoothed_offline(paper_map, folder)
    right = sum(abs(place - frame) <= 3 for frame, place, *_ in smoothed)
    assert right > 40


def test_smoothed_matches_are_recorded_as_the_library_gives_them(
    paper_host: Host, paper_map: Map, query_dir: Path, logs: Path, tmp_path: Path
) -> None:
    lines = tmp_path / "drive.jsonl"
    with Process(logs, "record", lines, "--endpoint", paper_host.endpoint) as record:
        wait_until(lambda: "\n" in record.out, "it records")
        paper_host.replay(query_dir)
        wait_until(lambda: lines.read_text().count("\n") == 2 * 60 + 1, "all is recorded")
        assert record.stop(signal.SIGINT) == 0
    recorded = [json.loads(line) for line in lines.read_text().splitlines()]
    smoothed = [one for one in recorded if one["smoothed"] and not one["end"]]
    smoothed.sort(key=lambda one: int(one["sequence"]))
    assert [
        (one["sequence"], one["place"], one["score"], one["lag"], tuple(one["missing"]))
        for one in smoothed
    ] == smoothed_offline(paper_map, query_dir)


def test_a_map_built_by_the_command_is_the_librarys(paper_map: Map, reference_dir: Path) -> None:
    flags = {"scales": {"channels": 3}, "features": {"dimensions": 16}}
    config = load_config(None, {"preset": "paper", **flags})
    built = build_map(sorted(reference_dir.iterdir()), config=config)
    assert built.metric == paper_map.metric
    for channel, other in zip(built.channels, paper_map.channels, strict=True):
        np.testing.assert_array_equal(channel.metric.projection, other.metric.projection)
        np.testing.assert_array_equal(channel.metric.places, other.metric.places)
        np.testing.assert_array_equal(channel.labels, other.labels)
        assert channel.smallest == other.smallest == 4


def test_without_the_preset_a_host_refuses_the_map_and_names_the_flag(
    paper_path: Path, endpoint: str
) -> None:
    line = refusal(placefield("up", paper_path, "--endpoint", endpoint))
    assert "plain PCA" in line
    assert "--preset paper" in line


def test_inspect_shows_the_preset_the_variance_that_is_kept_and_the_smallest_scale(
    paper_path: Path, paper_map: Map, tmp_path: Path
) -> None:
    inspected = placefield("inspect", paper_path, "-o", tmp_path / "segments.png")
    assert inspected.returncode == 0, inspected.stderr
    shown = dict(re.findall(r"^ *([a-z ]+?) {2}(\S.*)$", inspected.stdout, re.MULTILINE))
    assert shown["preset"] == "paper"
    kept = f"{paper_map.model.variance_kept:.1%} of the variance"
    assert shown["descriptor"] == f"gist, plain PCA, 16 dimensions that keep {kept}"
    assert shown["smallest scale"] == "4 frames"
    learned = f"lmnn, push {paper_map.metric.push_share:.3g}"
    assert shown["metric"] == f"{learned}: kept in 3 of 3 channels"


def test_config_shows_all_that_the_preset_sets() -> None:
    shown = placefield("config", "--preset", "paper", "--set", "scales.min_scale=6")
    assert shown.returncode == 0, shown.stderr
    settings = tomllib.loads(shown.stdout)
    assert settings["preset"] == "paper"
    assert settings["scales"]["min_scale"] == 6
    for section, values in PRESETS["paper"].items():
        assert settings[section].items() >= values.items()
