"""An output that cannot be written is refused before the work: here, before the input is read."""

from collections.abc import Iterator
from pathlib import Path

import click
import pytest
import typer
from typer.testing import CliRunner

from placefield.errors import ConfigError
from placefield.maps.manifest import MANIFEST
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield_tools.cli.main import app
from placefield_tools.cli.options_map import saved_new

COMMANDS = {
    "build": ["missing/", "-o", "{}.pfmap"],
    "add": ["missing.pfmap", "missing/", "-o", "{}.pfmap"],
    "drop": ["missing.pfmap", "drive", "-o", "{}.pfmap"],
    "join": ["missing.pfmap", "other.pfmap", "-o", "{}.pfmap"],
    "inspect": ["missing.pfmap", "-o", "{}.png"],
    "explore": ["mapper", "-o", "{}.pfmap"],
    "up": ["--explore", "{}.pfmap"],
    "record": ["{}.jsonl"],
    "export": ["missing.csv", "{}.tum", "--map", "missing.pfmap"],
    "loops": ["missing/", "-o", "{}.g2o"],
    "evaluate": ["missing.pfmap", "missing/", "-o", "{}"],
    "study": ["missing/", "missing/", "-o", "{}"],
    "demo": ["missing/", "missing/", "-o", "{}"],
    "bench scale": ["--picture", "{}.png"],
}
MAKE_FOLDERS = {"build", "add", "drop", "join", "up", "evaluate", "study", "demo"}


def commands_of(group: click.Command, name: str = "") -> Iterator[tuple[str, click.Command]]:
    if isinstance(group, click.Group):
        for each, command in group.commands.items():
            yield from commands_of(command, f"{name} {each}".strip())
    else:
        yield name, group


def refusal_of(command: str, output: str) -> str:
    arguments = [each.format(output) for each in COMMANDS[command]]
    return str(CliRunner().invoke(app, [*command.split(), *arguments]).exception)


def test_no_command_with_an_output_is_left_out_here() -> None:
    named = {"--output", "--picture"}
    found = {
        name
        for name, command in commands_of(typer.main.get_command(app))
        if any(named & set(option.opts) for option in command.params)
    }
    assert found <= set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_folder_that_is_a_file_is_refused(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    told = refusal_of(command, "file/out")
    assert "there is no folder file;" in told or "the folder cannot be made (" in told


@pytest.mark.parametrize("command", sorted(set(COMMANDS) - MAKE_FOLDERS))
def test_a_missing_folder_is_refused_where_none_is_made(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "there is no folder nodir; make it" in refusal_of(command, "nodir/out")
    assert not any(tmp_path.iterdir())


def test_a_map_that_another_process_made_during_the_work_is_not_overwritten(
    route_map: Map, tmp_path: Path
) -> None:
    path = tmp_path / "new.pfmap"

    def made_meanwhile(*, kept_in: Path) -> Map:
        save_map(route_map, path)
        return route_map

    with pytest.raises(ConfigError, match="is there already"):
        saved_new(made_meanwhile, path, overwrite=False)
    manifest = path / MANIFEST
    inode = manifest.stat().st_ino
    saved_new(lambda kept_in: route_map, path, overwrite=True)
    assert manifest.stat().st_ino != inode
