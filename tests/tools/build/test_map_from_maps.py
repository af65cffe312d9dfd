from pathlib import Path
from shutil import copy

import cv2
import numpy as np
import pytest
from lenses import pinhole
from typer.testing import CliRunner

from placefield.maps.opening import open_map
from placefield_tools.cli.main import app

QUICK = ["--channels", "1", "--metric", "identity"]


def invoke(*words: str | Path) -> str:
    done = CliRunner().invoke(app, [str(word) for word in words])
    return done.output + str(done.exception or "")


@pytest.fixture
def maps(reference_dir: Path, tmp_path: Path) -> list[Path]:
    """Maps of two parts of a drive, which share 25 frames."""
    files = sorted(reference_dir.iterdir())
    for name, frames in (("north", files[:40]), ("south", files[15:])):
        (tmp_path / name).mkdir()
        for file in frames:
            copy(file, tmp_path / name)
        invoke("build", tmp_path / name, *QUICK, "-o", tmp_path / f"{name}.pfmap")
    return [tmp_path / "north.pfmap", tmp_path / "south.pfmap"]


def test_maps_are_joined_where_they_share_a_stretch(maps: list[Path], tmp_path: Path) -> None:
    said = invoke("join", *maps, "-o", tmp_path / "town.pfmap")
    assert "south, place 0 to 24: the same stretch as north, place 15 to 39" in said
    graph = open_map(tmp_path / "town.pfmap").graph
    assert graph.names == ("north", "south")
    assert [39, 65] in graph.links.tolist()


def test_maps_with_one_mask_and_camera_are_joined_and_others_are_not(
    maps: list[Path], tmp_path: Path
) -> None:
    camera = pinhole(96, 72, 60).write(tmp_path / "camera.yaml")
    narrow = pinhole(96, 72, 80).write(tmp_path / "narrow.yaml")
    for name, columns in (("left", 30), ("right", 66)):
        used = np.full((72, 96), 255, np.uint8)
        used[:, columns:] = 0
        cv2.imwrite(str(tmp_path / f"{name}.png"), used)

    def build(name: str, *flags: str | Path) -> Path:
        path = tmp_path / f"{name}-masked.pfmap"
        flags = "--camera", camera, *flags
        invoke("build", tmp_path / name, *QUICK, *flags, "--overwrite", "-o", path)
        return path

    def join(*flags: str | Path) -> str:
        other = build("south", *flags)
        return invoke("join", north, other, "--overwrite", "-o", tmp_path / "town.pfmap")

    mask = "--mask", tmp_path / "left.png"
    north = build("north", *mask)
    assert "south, place 0 to 24: the same stretch as north, place 15 to 39" in join(*mask)
    model, own = open_map(tmp_path / "town.pfmap").model, open_map(north).model
    assert model.view == own.view
    assert model.mask is not None
    assert own.mask is not None
    np.testing.assert_array_equal(model.mask.used, own.mask.used)
    assert "its mask is not that of the first map" in join("--mask", tmp_path / "right.png")
    assert "its mask is not that of the first map" in join()
    assert "its view is not that of the first map" in join(*mask, "--query-camera", narrow)


def test_what_cannot_be_joined_is_refused_in_one_line(
    maps: list[Path], reference_dir: Path, tmp_path: Path
) -> None:
    town = tmp_path / "town.pfmap"
    assert "give two maps or more" in invoke("join", maps[0], "-o", town)
    assert "north.pfmap: is given twice" in invoke("join", maps[0], maps[0], "-o", town)
    assert "south.pfmap: is there already" in invoke("join", *maps, "-o", maps[1])
    gray = tmp_path / "gray.pfmap"
    invoke("build", reference_dir, *QUICK, "--feature", "grayscale", "-o", gray)
    said = invoke("join", maps[0], gray, "-o", town)
    assert "gray.pfmap: its features are grayscale" in said
    assert not town.exists()
