"""Changing a map on disk: by one process at a time."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from placefield.errors import MapError
from placefield.locking import take_lock
from placefield.maps.adding import check_growable
from placefield.maps.manifest import MANIFEST
from placefield.maps.map import Map
from placefield.maps.opening import open_map


@contextmanager
def map_to_change(path: Path) -> Iterator[Map]:
    """Open a map that no other process may change until the end of the block.

    The lock is on the manifest's file, and ends with the process. Reading is not affected.

    Raises:
        MapError: another process is changing the map; or see ``open_map`` and ``check_growable``.
        ConfigError: the system has no locks.
    """
    with _manifest_of(path) as manifest:
        if not take_lock(manifest):
            raise MapError(f"{path}: another process is changing it; try again when it is done")
        opened = open_map(path)
        # The manifest may be that of an old version, which another process has just replaced.
        if not os.path.samestat(os.fstat(manifest.fileno()), os.stat(path / MANIFEST)):
            raise MapError(f"{path}: another process has just changed it; try again")
        try:
            check_growable(opened)
        except MapError as error:
            raise MapError(f"{path}: {error}") from None
        yield opened


def _manifest_of(path: Path) -> IO[bytes]:
    try:
        return (path / MANIFEST).open("rb")
    except OSError:
        raise MapError(f"{path}: no map there; make one with 'placefield build'") from None
