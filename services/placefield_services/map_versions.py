"""The versions of the map at a path: the first is opened at once, later ones in the background."""

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Generic, TypeVar

from placefield.errors import PlacefieldError
from placefield.maps.manifest import MANIFEST
from placefield.maps.map import Map
from placefield.maps.opening import open_map

log = logging.getLogger(__name__)

_LOOK_EVERY_S = 1.0

_State = tuple[int, int, int, int]
"""Device, number, length and time of change of a manifest's file."""


class MapVersions:
    """Opens the map at a path, and each new version that replaces it there.

    A version has the lineage of the first one, see ``lineage_of``. Any other map, and one that is
    damaged, is reported once, and not opened.
    """

    def __init__(
        self, path: Path, channels: Collection[int] | None = (), lineage: str | None = None
    ) -> None:
        """Prepare to open maps.

        Args:
            path: of the map.
            channels: those that are read and checked when a version is opened; None: all.
            lineage: of all versions; None: that of the first.
        """
        self._path, self._channels = path, channels
        self._lineage = lineage
        self._seen: _State | None = None
        self._opened: tuple[_State | None, str] | None = None

    @property
    def path(self) -> Path:
        """The path of the map."""
        return self._path

    def open(self) -> Map:
        """Open the version that is there now.

        Raises:
            MapError: see ``open_map``.
        """
        self._seen = self._state()
        opened = open_map(self._path, self._channels, lineage=self._lineage)
        self._lineage = opened.lineage
        self._opened = self._seen, opened.digest
        return opened

    def is_there(self, digest: str) -> bool:
        """Whether the version that was opened last has this digest and is still at the path."""
        return self._opened == (self._state(), digest)

    def open_new(self) -> Map | None:
        """Open the map at the path, if it is another one than at the last look.

        None if it is the same, or if it cannot be served; then the reason is logged.
        """
        state = self._state()
        if state in (None, self._seen):
            return None
        serving = self._opened[1] if self._opened else "none"
        try:
            new = self.open()
        except PlacefieldError as error:
            if self._state() == state:  # else it was replaced while it was opened
                log.warning("%s; serving version %s on", error, serving)
            return None
        return None if new.digest == serving else new

    def _state(self) -> _State | None:
        """Return the state of the manifest's file; None if it is missing."""
        try:
            status = (self._path / MANIFEST).stat()
        except OSError:
            return None
        return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns


Prepared = TypeVar("Prepared")


class PreparedVersions(Generic[Prepared]):
    """Opens and prepares each new version of a map in a thread, while a service goes on."""

    def __init__(self, versions: MapVersions, prepare: Callable[[Map], Prepared]) -> None:
        """Watch for new versions; ``prepare`` makes what the service needs of a version."""
        self._versions, self._prepare = versions, prepare
        self._ready: SimpleQueue[Prepared] = SimpleQueue()
        threading.Thread(target=self._watch, daemon=True).start()

    def pop_all(self) -> Iterator[Prepared]:
        """Yield what was prepared since the last call, in order."""
        while not self._ready.empty():
            yield self._ready.get()

    def _watch(self) -> None:
        while True:
            time.sleep(_LOOK_EVERY_S)
            try:
                self._look()
            except PlacefieldError as error:
                log.warning("%s; serving the earlier version on", error)
            except Exception:
                log.exception("a defect; serving the earlier version on")

    def _look(self) -> None:
        """Prepare a new version, if there is one; keep no reference to it."""
        new = self._versions.open_new()
        if new is not None:
            self._ready.put(self._prepare(new))
