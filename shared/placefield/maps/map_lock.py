"""Locks a map on disk, so that one process at a time changes it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from placefield.errors import MapError
from placefield.locking import has_locks, take_lock
from placefield.maps.adding import check_growable
from placefield.maps.manifest import MANIFEST
from placefield.maps.map import Map
from placefield.maps.opening import open_map


@contextmanager
def open_locked(path: Path) -> Iterator[Map]:
    """Open a map that no other process may change until the end of the block.

    The lock is on the manifest's file, and ends with the process. Reading is not affected.

    Raises:
        MapError: another process is changing the map; or see ``open_map`` and ``check_growable``.
        ConfigError: the system has no locks.
    """
    with _locked(path):
        opened = open_map(path)
        try:
            check_growable(opened)
        except MapError as error:
            raise MapError(f"{path}: {error}") from None
        yield opened


@contextmanager
def replacing(path: Path) -> Iterator[None]:
    """Let no other process change the map at a path, if there is one, until the end of the block.

    On a system without locks nothing is locked.

    Raises:
        MapError: another process is changing the map.
    """
    if has_locks() and (path / MANIFEST).is_file():
        with _locked(path):
            yield
    else:
        yield


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    with _manifest_of(path) as manifest:
        if not take_lock(manifest):
            raise MapError(f"{path}: another process is changing it; try again when it is done")
        # The manifest may be that of an old version, which another process has just replaced.
        if not os.path.samestat(os.fstat(manifest.fileno()), os.stat(path / MANIFEST)):
            raise MapError(f"{path}: another process has just changed it; try again")
        yield


def _manifest_of(path: Path) -> IO[bytes]:
    try:
        return (path / MANIFEST).open("rb")
    except OSError:
        raise MapError(f"{path}: no map there; make one with 'placefield build'") from None
