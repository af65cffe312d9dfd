"""The command lines of a host's services."""

from pathlib import Path

from lenses import STRAIGHT

from placefield.config import Config
from placefield.features.camera_file import read_camera
from placefield.maps.manifest import read_manifest
from placefield_tools.up.service_commands import (
    GATEWAY,
    ServiceFlags,
    camera_flags,
    commands_on_map,
    exploring_commands,
)


def test_all_that_explore_and_the_gateway_of_a_map_know_the_camera(
    tmp_path: Path, map_path: Path
) -> None:
    own = camera_flags(STRAIGHT.calibration, tmp_path)
    assert own[0] == "--camera"
    assert read_camera(Path(own[1])) == STRAIGHT.calibration
    assert camera_flags(None, tmp_path) == []
    flags = ServiceFlags([], ["--topic", "/camera"], describers=2, camera=own)
    exploring = exploring_commands(tmp_path / "new.pfmap", Config(), flags)
    serving = commands_on_map(map_path, read_manifest(map_path), Config(), flags)

    def with_camera(commands: dict[str, list[str]]) -> set[str]:
        return {name for name, words in commands.items() if set(own) <= {*words}}

    assert with_camera(exploring) == {*exploring}
    assert {"describer 0", "describer 1", GATEWAY} < {*exploring}
    assert with_camera(serving) == {GATEWAY}
