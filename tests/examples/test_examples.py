"""Each example runs as its first lines say, and what it prints is right."""

import csv
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from hosting import Host, environment

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NEAR = 3  # places


def run(example: str, *arguments: str | Path, **settings: str) -> list[str]:
    ended = subprocess.run(
        [sys.executable, EXAMPLES / example, *arguments],
        capture_output=True,
        text=True,
        timeout=240,
        env=environment(**settings),
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines()


def right(places: list[int]) -> int:
    """Count the frames of the query that are recognised: frame i was taken at place i."""
    return sum(abs(place - frame) <= NEAR for frame, place in enumerate(places))


@pytest.fixture(scope="module")
def video(query_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The query as a camera films it."""
    pictures = [cv2.imread(str(file)) for file in sorted(query_dir.iterdir())]
    assert pictures[0] is not None
    height, width = pictures[0].shape[:2]
    file = tmp_path_factory.mktemp("filmed") / "drive.mp4"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), 10, (width, height))
    for picture in pictures:
        assert picture is not None
        writer.write(picture)
    writer.release()
    return file


@pytest.fixture(scope="module")
def host(map_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Host]:
    """The services of the map."""
    with Host(tmp_path_factory.mktemp("logs"), map_path) as running:
        yield running


def test_every_example_is_listed() -> None:
    listed = (EXAMPLES / "README.md").read_text()
    programs = sorted([*EXAMPLES.rglob("*.py"), *EXAMPLES.rglob("*.ipynb")])
    assert len(programs) >= 6
    assert [str(file) for file in programs if f"({file.relative_to(EXAMPLES)})" not in listed] == []


def test_two_folders(reference_dir: Path, query_dir: Path) -> None:
    printed = [line.split() for line in run("two_folders.py", reference_dir, query_dir)]
    files = sorted(file.name for file in query_dir.iterdir())
    assert [name for name, _, _ in printed] == files[-len(printed) :]
    assert right([int(place) for _, place, _ in printed]) >= 0.9 * len(files)


def test_a_rule_of_one_s_own(map_path: Path, query_dir: Path) -> None:
    printed = run("own_rule.py", map_path, query_dir)
    assert right([int(line.split()[1]) for line in printed]) >= 0.9 * len(printed) > 50


def test_a_camera_on_the_bus(host: Host, video: Path) -> None:
    printed = run("camera.py", video, PLACEFIELD_BUS__ENDPOINT=host.endpoint)
    places = [int(line.rstrip("?").split()[-1]) for line in printed]
    assert right(places) >= 0.9 * len(places) > 50


def test_a_feature_of_one_s_own(reference_dir: Path, query_dir: Path, tmp_path: Path) -> None:
    installed = tmp_path / "installed"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--target", installed]
    offline = ["--no-deps", "--no-index", "--no-build-isolation", EXAMPLES / "own_feature"]
    subprocess.run([*pip, *offline], check=True, capture_output=True)
    paths = os.pathsep.join(filter(None, [str(installed), os.environ.get("PYTHONPATH", "")]))
    own = "own_feature/own_feature.py"
    printed = run(own, reference_dir, query_dir, PYTHONPATH=paths)
    assert right([int(line.split()[1]) for line in printed]) >= 0.8 * len(printed) > 40


def test_a_recording_to_geojson(reference_dir: Path, video: Path, tmp_path: Path) -> None:
    day = Path(shutil.copytree(reference_dir, tmp_path / "day"))
    metres, degree = 5.0, 111_195.0  # from place to place to the north; of one degree
    names = sorted(file.name for file in day.iterdir())
    north = 48 + metres / degree * np.arange(len(names))
    with (day / "frames.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["file", "stamp", "latitude", "longitude"])
        rows.writerows([name, n, f"{north[n]:.9f}", "11.5"] for n, name in enumerate(names))
    route, written = tmp_path / "route.pfmap", tmp_path / "drive.geojson"
    build = [sys.executable, "-m", "placefield_tools", "build", day, "-o", route]
    flags = ["--metric", "identity", "--feature", "grayscale"]
    subprocess.run([*build, *flags], check=True, capture_output=True, env=environment())
    run("recording_to_geojson.py", route, video, written)
    points = json.loads(written.read_text())["features"]
    assert len(points) >= 0.8 * len(names)
    for point in points:
        longitude, latitude = point["geometry"]["coordinates"]
        assert longitude == pytest.approx(11.5, abs=1e-6)
        frame = point["properties"]["frame"]
        assert abs(latitude - north[frame]) * degree <= NEAR * metres + 1
