"""The same drive under another path or name is refused, wherever traverses are gathered."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from placefield.maps.manifest import read_manifest
from placefield_tools.cli.main import app


@pytest.fixture
def drive(reference_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A drive in the working folder, of which ``map_path`` is a map."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(reference_dir, "drive")
    shutil.copytree(reference_dir, "copy")
    Path("link").symlink_to("drive")
    return "drive"


def refusal_of(*command: str) -> str:
    return str(CliRunner().invoke(app, command).exception)


@pytest.mark.parametrize("again", ["drive", "./drive", "drive/", "link", "{here}/drive", "copy"])
def test_a_drive_is_refused_that_is_given_twice(drive: str, tmp_path: Path, again: str) -> None:
    again = again.format(here=tmp_path)
    told = f"{again}: is the same drive as {drive}"
    for options in ([], ["--routes"]):
        assert refusal_of("build", drive, again, *options, "-o", "new.pfmap").startswith(told)


def test_a_drive_is_refused_that_the_map_has(drive: str, map_path: Path, query_dir: Path) -> None:
    first = read_manifest(map_path).traverses[0].name
    told = refusal_of("add", str(map_path), "link", "-o", "new.pfmap")
    assert told.startswith(f"link: the map has this drive, as {first}: the frames are")
    grown = CliRunner().invoke(app, ["add", str(map_path), str(query_dir), "-o", "new.pfmap"])
    assert grown.exit_code == 0, grown.output
    shutil.copytree(query_dir, "dusk")
    told = refusal_of("add", "new.pfmap", "dusk")
    assert told.startswith(f"dusk: the map has this drive, as {query_dir}")


def test_frames_of_one_drive_twice_are_other_traverses(drive: str) -> None:
    """A map of one traverse may get a part of it, such as every other frame, as a further one."""
    Path("every_other").mkdir()
    for file in sorted(Path(drive).iterdir())[::2]:
        shutil.copy(file, "every_other")
    quick = ["--channels", "1", "--metric", "identity"]
    done = CliRunner().invoke(app, ["build", drive, "every_other", *quick, "-o", "new.pfmap"])
    assert done.exit_code == 0, done.output
