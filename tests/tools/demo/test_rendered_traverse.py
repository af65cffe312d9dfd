import csv
from pathlib import Path

import cv2
import numpy as np
import pytest

from placefield.errors import ConfigError
from placefield_tools.demo.rendered_traverse import render_traverse

FRAMES = 32


@pytest.fixture(scope="module")
def traverses(tmp_path_factory):
    folder = tmp_path_factory.mktemp("demo")
    for light in ("day", "dusk"):
        render_traverse(folder / light, light, frames=FRAMES)
    return folder


def images(folder: Path) -> list[np.ndarray]:
    return [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted(folder.glob("*.jpg"))]


def poses(folder: Path) -> np.ndarray:
    with (folder / "frames.csv").open() as table:
        rows = list(csv.DictReader(table))
    return np.array([[float(row[key]) for key in ("stamp", "x", "y", "yaw")] for row in rows])


def outline(image: np.ndarray) -> np.ndarray:
    """Describe an image by where its edges are, whatever its brightness."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    small = cv2.resize(grey, (64, 48), interpolation=cv2.INTER_AREA).astype(float)
    down, across = np.gradient(np.log(small + 20))
    edges = np.sqrt(np.hypot(across, down)).ravel()
    edges -= edges.mean()
    return edges / np.linalg.norm(edges)


def test_each_frame_is_a_colour_image_with_a_row_in_the_table(traverses):
    for light in ("day", "dusk"):
        folder = traverses / light
        names = sorted(path.name for path in folder.iterdir())
        assert names == [*(f"{i:05d}.jpg" for i in range(FRAMES)), "frames.csv"]
        assert {image.shape for image in images(folder)} == {(240, 320, 3)}
        lines = (folder / "frames.csv").read_text().splitlines()
        assert lines[0] == "file,stamp,x,y,yaw"
        assert [line.split(",")[0] for line in lines[1:]] == names[:-1]


def test_the_table_holds_a_drive_at_ten_hertz_and_a_metre_and_a_half_a_frame(traverses):
    stamp, x, y, yaw = poses(traverses / "day").T
    assert stamp == pytest.approx(np.arange(FRAMES) / 10)
    assert np.hypot(np.diff(x), np.diff(y)) == pytest.approx(1.5, abs=0.05)
    middle_yaw = (yaw[1:] + yaw[:-1]) / 2
    assert np.arctan2(np.diff(y), np.diff(x)) == pytest.approx(middle_yaw, abs=0.01)


def test_at_dusk_the_camera_drives_a_little_further_left(traverses):
    day, dusk = (poses(traverses / light) for light in ("day", "dusk"))
    yaw = day[:, 3]
    aside = (dusk[:, 1:3] - day[:, 1:3]).T
    assert yaw == pytest.approx(dusk[:, 3])
    assert aside[0] * np.cos(yaw) + aside[1] * np.sin(yaw) == pytest.approx(0, abs=0.01)
    left = -aside[0] * np.sin(yaw) + aside[1] * np.cos(yaw)
    assert left.min() > 0.29
    assert left.max() < 0.61


def test_dusk_is_darker_than_day_and_its_sky_bluer(traverses):
    day, dusk = (np.array(images(traverses / light), float) for light in ("day", "dusk"))
    assert dusk.mean() < 0.6 * day.mean()
    blue, _, red = dusk[:, :60, 140:180].mean(axis=(0, 1, 2))
    assert blue > 1.3 * red


def test_places_are_recognisable_across_the_lights(traverses):
    day, dusk = (
        np.array([outline(image) for image in images(traverses / light)])
        for light in ("day", "dusk")
    )
    nearest = (dusk @ day.T).argmax(axis=1)
    assert np.mean(np.abs(nearest - np.arange(FRAMES)) <= 3) >= 0.85


def test_same_arguments_give_same_bytes_and_another_seed_another_street(tmp_path, traverses):
    for name in ("first", "second"):
        render_traverse(tmp_path / name, "dusk", frames=2, seed=5)
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes()
        assert path.read_bytes() != (traverses / "dusk" / path.name).read_bytes()


def test_progress_is_reported_once_each_frame_is_there(tmp_path):
    reported = []

    def on_frame(number: int) -> None:
        assert (tmp_path / f"{number:05d}.jpg").stat().st_size > 0
        reported.append(number)

    render_traverse(tmp_path, "day", frames=3, on_frame=on_frame)
    assert reported == [0, 1, 2]


def test_a_traverse_without_frames_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="frames is 0"):
        render_traverse(tmp_path, "day", frames=0)
