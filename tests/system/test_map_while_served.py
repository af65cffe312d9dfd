"""Somebody spoils the files of a map that is being served."""

import os
from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import pytest
from hosting import Host, answers_of, offline, placefield, refusal, wait_until

from placefield.maps.map import Map, fingerprint
from placefield.maps.store import save_map
from placefield_tools.bench.feeding import Feeder
from placefield_tools.bench.random_walks import drive_along, observed_again, random_walk
from placefield_tools.bench.synthetic import made_map


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


def cut_off(file: Path) -> None:
    os.truncate(file, 5000)


def overwrite(file: Path) -> None:
    with file.open("r+b") as opened:
        opened.seek(5000)
        opened.write(bytes(10_000))


@pytest.mark.parametrize("spoil", [cut_off, overwrite])
def test_a_mapped_file_that_is_spoilt_ends_its_worker_with_one_line_and_no_answer_is_wrong(
    logs: Path, tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    walk = random_walk(14_000, 60, seed=0)
    query = observed_again(walk[drive_along(len(walk), 60, seed=1)], 0.5, seed=2)
    placemap, path = made_map(walk), tmp_path / "walk.pfmap"
    save_map(placemap, path)
    file = path / "metrics/0/places.npy"
    assert file.stat().st_size >= 2**20, "it is not mapped"
    with Host(logs, path, "--workers", "1") as host, host.listener() as listener:
        feeder = Feeder(listener.bus, "default", fingerprint(placemap.model))
        before, _ = feeder.feed(query)
        assert not any(match.missing for match in before)
        spoil(file)
        after, _ = feeder.feed(query)
        assert all(match.missing == (0, 1, 2, 3) for match in after)
        assert host.err.count(f"{file}: was written to while in use") == 1
        wait_until(lambda: f"{file}: damaged: its checksum is wrong" in host.err, "it is refused")
        assert "SIGBUS" not in host.err
