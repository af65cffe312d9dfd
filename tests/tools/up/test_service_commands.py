"""The command lines of a host's services."""

from itertools import pairwise
from pathlib import Path

import pytest
from lenses import STRAIGHT

from placefield.config import Config, MatchingConfig, Rule
from placefield.features.camera_file import read_camera
from placefield.maps.manifest import read_manifest
from placefield_tools.up import service_commands
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


@pytest.mark.parametrize(
    ("rule", "metrics", "workers", "channels_of_workers"),
    [
        ("filter", [0, 0, 0, 0], None, [[0, 1, 2, 3]]),
        ("filter", [0, 1, 0, 0], None, [[0, 2, 3], [1]]),
        ("filter", [0, 1, 2, 0], None, [[0, 3], [1, 2]]),
        ("evidence", [0, 0, 0, 0], None, [[0, 1], [2, 3]]),
        ("filter", [0, 0, 0, 0], 2, [[0, 1], [2, 3]]),
    ],
)
def test_no_two_workers_do_the_same_work_unless_told(
    rule: Rule,
    metrics: list[int],
    workers: int | None,
    channels_of_workers: list[list[int]],
    map_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(service_commands, "cores", lambda: 2)
    manifest = read_manifest(map_path)
    channels = tuple(manifest.channels[0].model_copy(update={"metric": one}) for one in metrics)
    config = Config(matching=MatchingConfig(rule=rule))
    commands = commands_on_map(
        map_path,
        manifest.model_copy(update={"channels": channels}),
        config,
        ServiceFlags([], workers=workers),
    )
    assert channels_of_workers == [
        [int(channel) for flag, channel in pairwise(words) if flag == "--channel"]
        for name, words in commands.items()
        if name.startswith("channel worker")
    ]
