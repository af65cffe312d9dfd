"""From a folder of frames to files of its loops, by the command."""

import csv
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from laps import FRAMES, PLACES, images_of_laps
from numpy.typing import NDArray
from typer.testing import CliRunner, Result

from placefield.errors import ConfigError, PlacefieldError, SourceError
from placefield_tools.cli.main import app

RADIUS = 20.0  # metres, of the circuit

Array = NDArray[np.float64]


def write_laps(folder: Path, columns: str = "", rows: list[str] | None = None) -> Path:
    """Write two laps of a circuit, whose views change gradually."""
    folder.mkdir()
    lines = [f"file,stamp{columns}"]
    for number, image in enumerate(images_of_laps()):
        cv2.imwrite(str(folder / f"{number:04}.png"), image)
        lines.append(f"{number:04}.png,{1000 + number / 10}{'' if rows is None else rows[number]}")
    (folder / "frames.csv").write_text("\n".join(lines))
    return folder


@pytest.fixture(scope="module")
def laps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_laps(tmp_path_factory.mktemp("made") / "laps")


@pytest.fixture(scope="module")
def laps_with_poses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    turns = [math.tau * number / PLACES for number in range(FRAMES)]
    rows = [
        f",{RADIUS * math.cos(turn)},{RADIUS * math.sin(turn)},{turn + math.pi / 2}"
        for turn in turns
    ]
    return write_laps(tmp_path_factory.mktemp("made") / "posed", ",x,y,yaw", rows)


def loops(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["loops", *map(str, arguments)])


def read_graph(path: Path) -> tuple[dict[int, Array], list[tuple[int, int, Array, Array]], int]:
    """Return vertices, edges with measurement and information matrix, and the fixed vertex."""
    vertices: dict[int, Array] = {}
    edges, fixed = [], []
    for line in path.read_text().splitlines():
        tag, *words = line.split()
        if tag == "VERTEX_SE2":
            assert len(words) == 4
            vertices[int(words[0])] = np.array([*map(float, words[1:])])
        elif tag == "EDGE_SE2":
            assert len(words) == 11
            values = np.array([*map(float, words[2:])])
            information = np.zeros((3, 3))
            information[np.triu_indices(3)] = values[3:]
            information = information + np.triu(information, 1).T
            edges.append((int(words[0]), int(words[1]), values[:3], information))
        else:
            assert tag == "FIX"
            fixed.append(int(words[0]))
    (first,) = fixed
    return vertices, edges, first


def assert_is_a_graph(path: Path) -> list[tuple[int, int, Array, Array]]:
    """Check a graph of the two laps, and return its loop edges."""
    vertices, edges, fixed = read_graph(path)
    assert [*vertices] == [*range(FRAMES)]
    assert fixed == 0
    # GTSAM 4.3 reads no edge after a line that it does not know.
    assert path.read_text().splitlines()[-1] == "FIX 0"
    for start, end, measured, information in edges:
        assert start in vertices
        assert end in vertices
        assert np.isfinite(measured).all()
        assert (np.linalg.eigvalsh(information) > 0).all()
    assert [(start, end) for start, end, *_ in edges[: FRAMES - 1]] == [
        (number, number + 1) for number in range(FRAMES - 1)
    ]
    closing = edges[FRAMES - 1 :]
    assert len(closing) >= 55
    for start, end, measured, _ in closing:
        assert abs(end - start - PLACES) <= 3
        np.testing.assert_array_equal(measured, 0)
    return closing


def test_a_csv_has_every_frame_and_finds_the_second_lap(laps: Path, tmp_path: Path) -> None:
    result = loops(laps, "-o", tmp_path / "loops.csv")
    assert result.exit_code == 0, result.output
    with (tmp_path / "loops.csv").open() as file:
        rows = [*csv.DictReader(file)]
    assert [int(row["frame"]) for row in rows] == [*range(FRAMES)]
    assert int(rows[3]["stamp_ns"]) == 1_000_300_000_000
    assert rows[0]["place"] == rows[0]["place_stamp_ns"] == ""
    assert float(rows[0]["new_probability"]) == 1
    found = [row for row in rows if row["smoothed_known"] == "1"]
    assert f"{len(found)} of {FRAMES} frames" in result.stdout
    assert len(found) >= 55
    for row in found:
        assert abs(int(row["frame"]) - int(row["smoothed_place"]) - PLACES) <= 3
        stamp = 1_000_000_000_000 + 100_000_000 * int(row["smoothed_place"])
        assert int(row["smoothed_place_stamp_ns"]) == stamp
        assert float(row["smoothed_probability"]) >= 0.99


def test_a_json_has_what_the_csv_has(laps: Path, tmp_path: Path) -> None:
    for suffix in ("csv", "json"):
        assert loops(laps, "-o", tmp_path / f"loops.{suffix}").exit_code == 0
    with (tmp_path / "loops.csv").open() as file:
        rows = [*csv.DictReader(file)]
    for row, each in zip(rows, json.loads((tmp_path / "loops.json").read_text()), strict=True):
        assert int(row["frame"]) == each["frame"]
        for answer, prefix in (("causal", ""), ("smoothed", "smoothed_")):
            for key, value in each[answer].items():
                cell = "" if value is None else str(int(value) if key == "known" else value)
                assert row[prefix + key] == cell


def test_a_graph_without_motion_has_steps_of_one_unit(laps: Path, tmp_path: Path) -> None:
    assert loops(laps, "-o", tmp_path / "loops.g2o").exit_code == 0
    assert_is_a_graph(tmp_path / "loops.g2o")
    _, edges, _ = read_graph(tmp_path / "loops.g2o")
    for *_, measured, information in edges[: FRAMES - 1]:
        assert measured.tolist() == [1, 0, 0]
        assert information[0, 0] <= 1


def test_a_graph_with_poses_has_the_motion_between_them(
    laps_with_poses: Path, tmp_path: Path
) -> None:
    assert loops(laps_with_poses, "-o", tmp_path / "loops.g2o").exit_code == 0
    closing = assert_is_a_graph(tmp_path / "loops.g2o")
    vertices, edges, _ = read_graph(tmp_path / "loops.g2o")
    chord = 2 * RADIUS * math.sin(math.pi / PLACES)
    for start, end, (x, y, yaw), _ in edges[: FRAMES - 1]:
        assert math.hypot(x, y) == pytest.approx(chord, rel=1e-5)
        assert yaw == pytest.approx(math.tau / PLACES, rel=1e-5)
        pose = vertices[start]
        cosine, sine = math.cos(pose[2]), math.sin(pose[2])
        there = pose[:2] + np.array([cosine * x - sine * y, sine * x + cosine * y])
        np.testing.assert_allclose(there, vertices[end][:2], atol=1e-5)
    assert all(information[0, 0] > 0.02 for *_, information in closing)


def test_a_graph_with_odometry_has_its_metres(tmp_path: Path) -> None:
    rows = [f",{2.5 * number}" for number in range(FRAMES)]
    drive = write_laps(tmp_path / "drive", ",odometry", rows)
    assert loops(drive, "-o", tmp_path / "loops.g2o").exit_code == 0
    assert_is_a_graph(tmp_path / "loops.g2o")
    _, edges, _ = read_graph(tmp_path / "loops.g2o")
    for *_, measured, information in edges[: FRAMES - 1]:
        assert measured.tolist() == [2.5, 0, 0]
        assert information[0, 0] > information[1, 1]  # the direction is not known


def test_a_lower_precision_gives_more_loops(laps: Path, tmp_path: Path) -> None:
    counts = [
        json.loads(
            loops(laps, "-o", tmp_path / f"{part}.csv", "--precision", part, "--json").stdout
        )["in_loops"]
        for part in ("0.5", "0.999")
    ]
    assert counts[0] > counts[1] > 0


def test_an_unreadable_frame_is_a_missing_observation(laps: Path, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    drive.mkdir()
    for file in laps.glob("*.png"):
        (drive / file.name).write_bytes(file.read_bytes())
    (drive / "0090.png").write_bytes(b"no image")
    result = loops(drive, "-o", tmp_path / "loops.csv", "--json")
    assert json.loads(result.stdout)["frames"] == FRAMES
    assert json.loads(result.stdout)["in_loops_smoothed"] >= 55


def failure(*arguments: object) -> PlacefieldError:
    error = loops(*arguments).exception
    assert isinstance(error, PlacefieldError)
    assert "\n" not in str(error)
    return error


def test_errors_say_what_to_do(laps: Path, tmp_path: Path) -> None:
    unknown = failure(laps, "-o", tmp_path / "loops.xml")
    assert isinstance(unknown, ConfigError)
    assert ".g2o, .csv, .json" in str(unknown)
    (tmp_path / "there.csv").write_text("")
    assert "exists already" in str(failure(laps, "-o", tmp_path / "there.csv"))
    missing = failure(tmp_path / "nowhere", "-o", tmp_path / "loops.csv")
    assert isinstance(missing, SourceError)
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "0.png").write_bytes(b"no image")
    assert "no frame can be read" in str(failure(broken, "-o", tmp_path / "loops.csv"))
    assert not (tmp_path / "loops.csv").exists()
