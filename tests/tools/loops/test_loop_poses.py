"""Loop edges carry the relative pose of their images, where the camera is known."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from lenses import pinhole
from typer.testing import CliRunner

from placefield.config import Config
from placefield.errors import ConfigError
from placefield_tools.cli.main import app
from placefield_tools.loops.finding import DriveLoops, find_loops
from placefield_tools.sources import Parts, open_source

PLACES, FOCAL, YAW = 60, 0.9, 0.05  # radians, by which the camera is turned on the second lap
WIDTH, HEIGHT = 160, 120


@pytest.fixture(scope="module")
def turned_laps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two laps of distinct views; on the second, the camera is turned to the left."""
    folder = tmp_path_factory.mktemp("made") / "laps"
    folder.mkdir()
    rng = np.random.default_rng(0)
    view, views = rng.normal(size=(9, 12)), []
    for _ in range(PLACES):
        view = 0.7 * view + rng.normal(size=(9, 12))
        smooth = cv2.resize(128 + 25 * view, (WIDTH, HEIGHT))
        dots = cv2.resize(rng.normal(scale=25, size=(40, 53)), (WIDTH, HEIGHT))
        views.append(np.clip(smooth + dots, 0, 255).astype(np.uint8))
    camera = np.array(
        [[FOCAL * WIDTH, 0, (WIDTH - 1) / 2], [0, FOCAL * WIDTH, (HEIGHT - 1) / 2], [0, 0, 1]]
    )
    turn = cv2.Rodrigues(np.array([0, YAW, 0]))[0]  # a point ahead moves to the right
    homography = camera @ turn @ np.linalg.inv(camera)
    for lap in range(2):
        for number, each in enumerate(views):
            image = each if lap == 0 else cv2.warpPerspective(each, homography, (WIDTH, HEIGHT))
            cv2.imwrite(str(folder / f"{lap * PLACES + number:04}.png"), image)
    return folder


def loop_edges(folder: Path, output: Path, *flags: str) -> list[list[float]]:
    found = CliRunner().invoke(app, ["loops", str(folder), "-o", str(output), *flags])
    assert found.exit_code == 0, found.output
    words = [line.split() for line in output.read_text().splitlines()]
    edges = [[*map(float, each[1:])] for each in words if each[0] == "EDGE_SE2"]
    return [edge for edge in edges if edge[1] - edge[0] == PLACES]


def test_a_loop_has_the_yaw_of_the_camera_against_the_first_lap(
    turned_laps: Path, tmp_path: Path
) -> None:
    edges = loop_edges(turned_laps, tmp_path / "turned.g2o", "--set", f"verification.focal={FOCAL}")
    assert len(edges) >= 30
    yaws, deviations = np.array([(edge[4], 1 / math.sqrt(edge[10])) for edge in edges]).T
    assert np.median(yaws) == pytest.approx(YAW, abs=0.003)
    assert (np.abs(yaws - YAW) < 4 * deviations).all()


def test_the_focal_length_is_that_of_the_camera_file(turned_laps: Path, tmp_path: Path) -> None:
    camera = pinhole(WIDTH, HEIGHT, FOCAL * WIDTH).write(tmp_path / "camera.yaml")

    def found(config: Config) -> DriveLoops:
        source = open_source(str(turned_laps), parts=Parts(stop=12, camera=camera))
        return find_loops(source, "laps", config)

    loops = found(Config())
    assert loops.camera is not None
    assert loops.camera.focal == pytest.approx(FOCAL)
    assert loops.frames[0].local_features is not None
    both = Config.model_validate({"verification": {"focal": 1.0}})
    with pytest.raises(ConfigError, match=r"^setting verification\.focal: .*calibration gives it"):
        found(both)


def test_without_a_camera_a_loop_is_the_same_pose(turned_laps: Path, tmp_path: Path) -> None:
    edges = loop_edges(turned_laps, tmp_path / "same.g2o")
    assert {tuple(edge[2:5]) for edge in edges} == {(0.0, 0.0, 0.0)}
