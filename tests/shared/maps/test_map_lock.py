"""One process at a time changes a map on disk."""

from pathlib import Path
from typing import IO

import pytest

from placefield.errors import MapError
from placefield.locking import take_lock
from placefield.maps.manifest import MANIFEST
from placefield.maps.map import Map
from placefield.maps.map_lock import open_locked, replacing
from placefield.maps.store import save_map


def test_a_second_process_is_refused_until_the_first_is_done(saved: Path) -> None:
    with open_locked(saved), pytest.raises(MapError) as refused, open_locked(saved):
        pass
    assert str(refused.value).startswith(f"{saved}: another process is changing it; try again")
    with open_locked(saved) as opened:
        assert opened.is_saved


def test_a_version_that_was_replaced_while_the_lock_was_awaited_is_not_changed(
    saved: Path, small_map: Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    def replaced(manifest: IO[bytes]) -> bool:
        save_map(small_map, saved)
        return take_lock(manifest)

    monkeypatch.setattr("placefield.maps.map_lock.take_lock", replaced)
    with pytest.raises(MapError, match="another process has just changed it"), open_locked(saved):
        pass


def test_a_map_that_is_being_replaced_is_not_changed_and_a_new_or_damaged_one_needs_no_lock(
    saved: Path, tmp_path: Path
) -> None:
    with replacing(saved), pytest.raises(MapError, match="is changing it"), open_locked(saved):
        pass
    with open_locked(saved), pytest.raises(MapError, match="is changing it"), replacing(saved):
        pass
    (tmp_path / "damaged.pfmap").mkdir()
    for free in (tmp_path / "new.pfmap", tmp_path / "damaged.pfmap"):
        with replacing(free), replacing(free):
            pass


def test_no_map_and_a_map_that_cannot_grow_are_named(saved: Path, tmp_path: Path) -> None:
    nothing = tmp_path / "nothing.pfmap"
    with pytest.raises(MapError, match=f"{nothing}: no map there"), open_locked(nothing):
        pass
    (saved / MANIFEST).write_text("{}")
    with pytest.raises(MapError, match=str(saved)), open_locked(saved):
        pass


def test_folders_of_killed_writers_are_removed_and_those_of_living_ones_are_not(
    small_map: Map, tmp_path: Path
) -> None:
    path = tmp_path / "route.pfmap"
    dead = tmp_path / ".route.pfmap.dead"
    (dead / "new").mkdir(parents=True)
    (dead / "locked").touch()
    unmarked = tmp_path / ".route.pfmap.begun"
    unmarked.mkdir()
    other = tmp_path / ".other.pfmap.dead"
    other.mkdir()
    (other / "locked").touch()
    with (dead / "locked").open("rb") as living:
        assert take_lock(living)
        save_map(small_map, path)
        assert dead.exists()
    save_map(small_map, path)
    assert set(tmp_path.iterdir()) == {path, unmarked, other}
