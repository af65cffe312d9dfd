from pathlib import Path
from shutil import copy

import cv2
import numpy as np
import pytest
from lenses import pinhole
from typer.testing import CliRunner

from placefield.errors import ConfigError
from placefield.features.rectification import view_of
from placefield.maps.opening import open_map
from placefield_tools.build.routes_from_sources import link_of
from placefield_tools.cli.main import app

QUICK = ["--channels", "1", "--metric", "identity"]


@pytest.fixture
def roads(reference_dir: Path, tmp_path: Path) -> list[str]:
    """Two routes of a drive, which share 25 frames."""
    files = sorted(reference_dir.iterdir())
    for name, frames in (("north", files[:40]), ("south", files[15:])):
        (tmp_path / name).mkdir()
        for file in frames:
            copy(file, tmp_path / name)
    return [str(tmp_path / "north"), str(tmp_path / "south")]


def test_routes_that_share_a_stretch_are_built_as_one_network(
    roads: list[str], tmp_path: Path
) -> None:
    path = tmp_path / "town.pfmap"
    options = [*QUICK, "--set", "build.local_features=50"]
    done = CliRunner().invoke(app, ["build", *roads, "--routes", *options, "-o", str(path)])
    assert done.exit_code == 0, done.output
    opened = open_map(path)
    assert opened.local_features is not None
    assert len(opened.local_features.ends) == 85
    graph = opened.graph
    assert graph.names == ("north", "south")
    assert graph.first.tolist() == [0, 40]
    assert "south, place 0 to 24: the same stretch as north, place 15 to 39" in done.output
    assert "link: from north, place 39, to south, place 25" in done.output
    assert [39, 65] in graph.links.tolist()


def test_all_routes_have_the_mask_and_the_camera_that_are_given(
    roads: list[str], tmp_path: Path
) -> None:
    camera = pinhole(96, 72, 60).write(tmp_path / "camera.yaml")
    used = np.full((72, 96), 255, np.uint8)
    used[60:] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), used)
    flags = ["--routes", "--mask", str(tmp_path / "mask.png"), "--camera", str(camera)]
    path = tmp_path / "town.pfmap"
    done = CliRunner().invoke(app, ["build", *roads, *flags, *QUICK, "-o", str(path)])
    assert "the mask hides 17% of each image" in done.output
    model = open_map(path).model
    assert model.view == view_of(pinhole(96, 72, 60).calibration)
    assert model.mask is not None
    np.testing.assert_array_equal(model.mask.used, used > 0)


def test_a_route_that_is_linked_to_nothing_is_warned_of_unless_a_link_is_given(
    reference_dir: Path, roads: list[str], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    files = sorted(reference_dir.iterdir())
    (tmp_path / "far").mkdir()
    for file in files[40:]:
        copy(file, tmp_path / "far")
    command = ["build", roads[0], str(tmp_path / "far"), "--routes", *QUICK]
    CliRunner().invoke(app, [*command, "-o", str(tmp_path / "apart.pfmap")])
    assert "far: is linked to no other route" in caplog.text
    caplog.clear()
    given = ["--link", "north:39,far:0", "-o", str(tmp_path / "linked.pfmap")]
    CliRunner().invoke(app, [*command, *given])
    assert "linked to no other" not in caplog.text
    assert open_map(tmp_path / "linked.pfmap").graph.links.tolist() == [[39, 40]]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--link", "A:1,B:0"], "give --routes"),
        (["--same-frame"], "give --routes"),
        (["--routes", "--one-drive"], "give one of them"),
        (["--routes", "--poses", "poses.txt"], "--poses is of one route"),
        (["--routes", "--link", "A:1"], "write it as ROUTE:PLACE,ROUTE:PLACE"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    roads: list[str], tmp_path: Path, options: list[str], reason: str
) -> None:
    command = ["build", *roads, *options, "-o", str(tmp_path / "a.pfmap")]
    done = CliRunner().invoke(app, command)
    assert done.exit_code != 0
    assert reason in str(done.exception) + done.output


def test_a_name_of_a_route_may_hold_a_colon() -> None:
    assert link_of("drive:7:12,B:0") == ("drive:7", 12, "B", 0)
    with pytest.raises(ConfigError, match="--link"):
        link_of("A:x,B:0")
