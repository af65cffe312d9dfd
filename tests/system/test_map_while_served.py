"""Somebody spoils the files of a map that is being served."""

import os
from pathlib import Path
from shutil import copytree

from hosting import Host, answers_of, offline, placefield, refusal

from placefield.maps.map import Map


def test_a_small_map_is_served_on_whatever_becomes_of_its_files(
    logs: Path, map_path: Path, route_map: Map, query_dir: Path, tmp_path: Path
) -> None:
    expected = offline(route_map, sorted(query_dir.iterdir()))
    own = copytree(map_path, tmp_path / "own.pfmap")
    with Host(logs, own, "--workers", "2") as host, host.listener() as listener:
        host.replay(query_dir)
        assert answers_of(listener.answers()) == expected
        for number, file in enumerate(sorted(own.rglob("*.npy"))):
            if number % 2:
                os.truncate(file, 100)
            else:
                file.write_bytes(bytes(file.stat().st_size))
        host.replay(query_dir)
        assert answers_of(listener.answers()) == expected
        assert not host.err
    assert "damaged: its checksum is wrong" in refusal(placefield("featurizer", own))
