"""Which maps are versions of the one at a path, by their digests."""

from dataclasses import replace
from pathlib import Path
from shutil import rmtree

import pytest

from placefield.errors import MapError
from placefield.maps.manifest import ChangeRecord, read_identified
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield.maps.version_digests import VersionDigests

MISSED = "a" * 16
"""The digest of a version that was replaced before anybody looked."""


def put(placemap: Map, path: Path) -> str:
    save_map(placemap, path)
    return read_identified(path)[1]


def test_versions_at_the_path_are_known_and_those_that_their_history_names(
    small_map: Map, tmp_path: Path
) -> None:
    path = tmp_path / "route.pfmap"
    first = put(small_map, path)
    versions = VersionDigests(path)
    assert first in versions
    assert MISSED not in versions
    changes = [ChangeRecord(change="added", drive="dusk", before=MISSED)]
    later = put(replace(small_map, history=tuple(changes)), path)
    assert {first, MISSED, later} == {each for each in (first, MISSED, later) if each in versions}
    assert MISSED in VersionDigests(path)


def test_another_map_at_the_path_is_no_version(small_map: Map, tmp_path: Path) -> None:
    path = tmp_path / "route.pfmap"
    first = put(small_map, path)
    versions = VersionDigests(path)
    of_other_metres = put(replace(small_map, pose_frame="wgs84 48.0 16.0"), path)
    assert of_other_metres not in versions
    of_other_channels = put(replace(small_map, channels=small_map.channels[:1]), path)
    assert of_other_channels not in versions
    rmtree(path)
    assert "b" * 16 not in versions
    assert first in versions
    with pytest.raises(MapError, match="no map there"):
        VersionDigests(path)
