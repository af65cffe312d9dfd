"""Receiving a map in chunks: it is written to a partial folder, checked, and renamed at the end.

An interrupted download is kept. The next one checks the chunks that are there and goes on.
"""

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from placefield.errors import MapError
from placefield.files import sync, write_whole
from placefield.locking import take_lock
from placefield.maps.checksums import checksum_of
from placefield.maps.manifest import LONGEST_MANIFEST, MANIFEST, SEAL, seal_of
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.transfer import CHUNK, Chunk, Offer, chunk_count, chunks_of, file_in

PARTIAL = ".partial"
"""The suffix of the folder of a map that has not arrived in full."""

_LOCK = ".lock"


def opened_if_there(path: Path, offer: Offer) -> Map | None:
    """Open the map at a path if it is the offered one; return None if the path does not exist.

    Raises:
        MapError: the path holds something else, or its map is damaged.
    """
    if not os.path.lexists(path):
        return None
    if _bytes_of(path / MANIFEST) != offer.written:
        raise MapError(
            f"{path}: exists and is not the offered map; "
            "remove it, or choose another folder with --to"
        )
    return open_map(path)


@contextmanager
def receiving(path: Path) -> Iterator["PartialMap"]:
    """Receive a map for this path, under a lock; chunks that arrived stay for the next attempt.

    Raises:
        MapError: another process receives it, or the disk refuses.
    """
    partial = PartialMap(path)
    with _disk_errors_reported(path):
        partial.folder.mkdir(parents=True, exist_ok=True)
        with _locked(partial.folder):
            try:
                yield partial
            finally:
                partial.leave()


class PartialMap:
    """A map that has arrived in part.

    Attributes:
        folder: the partial folder.
        there: how many of its chunks have arrived, right or not.
    """

    def __init__(self, path: Path) -> None:
        self.folder = path.with_name(path.name + PARTIAL)
        self.there = 0
        self._path = path
        self._offer: Offer | None = None

    def begin(self, offer: Offer) -> None:
        """Begin to receive this map; chunks of it are kept, and those of another map removed.

        Raises:
            MapError: the offer is refused, see ``Offer.check``, or the disk has too little room.
        """
        offer.check()
        if _bytes_of(self.folder / MANIFEST) != offer.written:
            self._empty()
            (self.folder / MANIFEST).write_bytes(offer.written)
        self._offer = offer
        self.there = sum(self._arrived(name, size) for name, size in offer.sizes.items())
        self._check_room(CHUNK * (offer.chunks - self.there))

    def missing(self) -> Iterator[Chunk]:
        """Yield the missing chunks; the caller gives each to ``add`` before it asks for the next.

        Raises:
            MapError: the checksum of a file that has arrived in full is wrong.
        """
        for name, checksum in self._begun.files.items():
            yield from self._missing_of(name, self._begun.sizes[name], checksum)

    def _missing_of(self, name: str, size: int, checksum: str) -> Iterator[Chunk]:
        file = file_in(self.folder, name)
        kept = self._arrived(name, size)
        yield from chunks_of(name, size, kept)
        if kept and checksum_of(file) != checksum:  # the kept chunks may be damaged
            self.there -= chunk_count(size)
            yield from chunks_of(name, size)
        if checksum_of(file) != checksum:
            file.unlink()
            raise MapError(
                f"{self._path}: {name} arrives with a wrong checksum: the server's map is damaged; "
                "build it again there"
            )

    def add(self, chunk: Chunk, data: bytes) -> None:
        """Write a chunk of the right length; the chunks of a file come in order."""
        file = file_in(self.folder, chunk.file)
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("r+b" if chunk.number else "wb") as opened:
            opened.seek(CHUNK * chunk.number)
            opened.write(data)
        self.there += 1

    def finish(self) -> Map:
        """Check the complete map, move it to its path and return it, opened.

        Raises:
            MapError: it cannot be opened.
        """
        for name in self._begun.files:
            sync(file_in(self.folder, name))
        write_whole(self.folder / MANIFEST, self._begun.written)
        write_whole(self.folder / SEAL, seal_of(self._begun.written))
        opened = open_map(self.folder)
        self.folder.rename(self._path)
        (self._path / _LOCK).unlink()
        return opened

    def leave(self) -> None:
        """Keep the chunks that arrived for the next attempt; remove a folder without any."""
        if self._offer is None and not (self.folder / MANIFEST).exists():
            shutil.rmtree(self.folder)

    @property
    def _begun(self) -> Offer:
        assert self._offer is not None, "begin first"
        return self._offer

    def _arrived(self, name: str, size: int) -> int:
        """Return how many whole chunks of a file have arrived, right or not."""
        file = file_in(self.folder, name)
        length = file.stat().st_size if file.is_file() else 0
        return chunk_count(size) if length == size else min(length, size - 1) // CHUNK

    def _check_room(self, needed: int) -> None:
        free = shutil.disk_usage(self.folder).free
        if needed > free:
            raise MapError(
                f"{self._path}: {_mib(needed)} MiB are still missing, and the disk has "
                f"{_mib(free)} MiB free; free some space, or choose another folder with --to"
            )

    def _empty(self) -> None:
        for entry in self.folder.iterdir():
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry)
            elif entry.name != _LOCK:
                entry.unlink()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder; the system releases it when the process ends, even if killed."""
    lock = folder / _LOCK
    with lock.open("ab") as opened:
        # the process that held the lock may have just renamed the folder
        is_held = (
            take_lock(opened)
            and lock.exists()
            and os.path.samestat(os.fstat(opened.fileno()), lock.stat())
        )
        if not is_held:
            raise MapError(f"{folder}: another process fetches it; wait for that, and try again")
        yield


@contextmanager
def _disk_errors_reported(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        what = "the disk is full; free some space" if full else (error.strerror or str(error))
        raise MapError(f"{path}: cannot be fetched: {what}") from None


def _bytes_of(file: Path) -> bytes | None:
    try:
        with file.open("rb") as opened:
            return opened.read(LONGEST_MANIFEST + 1)
    except OSError:
        return None


def _mib(count: int) -> int:
    return count // 2**20
