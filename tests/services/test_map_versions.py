"""Which maps that replace the served one are opened, and what is said of the others."""

import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copytree, rmtree

import numpy as np
import pytest

from placefield.errors import ConfigError
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield_services import map_versions
from placefield_services.map_versions import MapVersions, PreparedVersions


@pytest.fixture
def path(tmp_path: Path, map_path: Path) -> Path:
    return Path(copytree(map_path, tmp_path / "served.pfmap"))


def newer(placemap: Map) -> Map:
    return replace(placemap, seed=placemap.seed + 1)


def of_another_model(placemap: Map) -> Map:
    return replace(placemap, model=replace(placemap.model, mean=np.array(placemap.model.mean) + 1))


def of_fewer_channels(placemap: Map) -> Map:
    return replace(placemap, channels=placemap.channels[:-1])


def test_a_version_that_replaces_the_map_is_opened_once(path: Path, route_map: Map) -> None:
    versions = MapVersions(path, [0])
    first = versions.open()
    assert versions.open_new() is None
    save_map(newer(route_map), path)
    assert not versions.is_there(first.digest)
    new = versions.open_new()
    assert new is not None
    assert new.digest != first.digest
    assert versions.is_there(new.digest)
    assert versions.open_new() is None


def test_the_same_map_put_there_again_is_no_new_version(path: Path, map_path: Path) -> None:
    versions = MapVersions(path)
    versions.open()
    rmtree(path)
    assert versions.open_new() is None
    copytree(map_path, path)
    assert versions.open_new() is None


@pytest.mark.parametrize("make", [of_another_model, of_fewer_channels])
def test_a_map_of_another_lineage_is_reported_once_and_a_later_version_is_opened(
    path: Path, route_map: Map, make: Callable[[Map], Map], caplog: pytest.LogCaptureFixture
) -> None:
    versions = MapVersions(path)
    first = versions.open()
    save_map(make(route_map), path)
    assert [versions.open_new() for _ in range(3)] == [None] * 3
    (line,) = caplog.messages
    assert line.startswith(f"{path}: is no version of the served map: ")
    assert line.endswith(f"; serving version {first.digest} on")
    save_map(newer(route_map), path)
    assert versions.open_new() is not None


def test_a_damaged_version_is_reported_once(
    path: Path, route_map: Map, caplog: pytest.LogCaptureFixture
) -> None:
    versions = MapVersions(path, [0])
    versions.open()
    save_map(newer(route_map), path)
    os.truncate(path / "places" / "stamps.npy", 100)
    assert [versions.open_new() for _ in range(2)] == [None] * 2
    (line,) = caplog.messages
    assert "stamps.npy: damaged: its checksum is wrong" in line


def test_versions_are_prepared_in_the_background_and_one_that_cannot_be_is_reported(
    path: Path, route_map: Map, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(map_versions, "_LOOK_EVERY_S", 0.01)
    versions = MapVersions(path)
    versions.open()
    refused: list[str] = []

    def prepare(placemap: Map) -> str:
        if not refused:
            refused.append(placemap.digest)
            raise ConfigError("too few places")
        return placemap.digest

    prepared = PreparedVersions(versions, prepare)
    ready: list[str] = []
    for number in range(2):
        save_map(replace(route_map, seed=number + 100), path)
        end = time.monotonic() + 60
        while len(refused) + len(ready) < number + 1 and time.monotonic() < end:
            time.sleep(0.01)
            ready += prepared.pop_all()
    assert [versions.is_there(digest) for digest in (*refused, *ready)] == [False, True]
    assert [line for line in caplog.messages if "too few places" in line] == [
        "too few places; serving the earlier version on"
    ]
