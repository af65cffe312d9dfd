"""A map that arrives in chunks: written beside its place, renamed when all of it checks out.

What has arrived is kept when the work is cut off, and is checked before more of it is asked for.
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
"""What is added to the name of a map that has not arrived in full."""

_LOCK = ".lock"


def opened_if_there(path: Path, offer: Offer) -> Map | None:
    """Open the map at a path if it is the one that is offered; None if nothing is there.

    Raises:
        MapError: something else is there; the map there is damaged.
    """
    if not os.path.lexists(path):
        return None
    if _bytes_of(path / MANIFEST) != offer.written:
        raise MapError(
            f"{path}: is there and is not the map that is offered; "
            "remove it, or choose another folder with --to"
        )
    return open_map(path)


@contextmanager
def receiving(path: Path) -> Iterator["PartialMap"]:
    """Receive a map for this path, alone; whatever has arrived stays for the next time.

    Raises:
        MapError: somebody else receives it, or the disk refuses.
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
        folder: where it is.
        there: how many of its chunks are there, as far as one knows.
    """

    def __init__(self, path: Path) -> None:
        self.folder = path.with_name(path.name + PARTIAL)
        self.there = 0
        self._path = path
        self._offer: Offer | None = None

    def begin(self, offer: Offer) -> None:
        """Receive this map: go on with what is there of it, begin anew if that is of another one.

        Raises:
            MapError: see ``Offer.check``; the map is larger than the room on the disk.
        """
        offer.check()
        if _bytes_of(self.folder / MANIFEST) != offer.written:
            self._empty()
            (self.folder / MANIFEST).write_bytes(offer.written)
        self._offer = offer
        self.there = sum(self._arrived(name, size) for name, size in offer.sizes.items())
        self._check_room(CHUNK * (offer.chunks - self.there))

    def missing(self) -> Iterator[Chunk]:
        """Yield the chunks that are missing, each to be given to ``add`` before the next.

        Raises:
            MapError: a file that has arrived in full is not what the manifest says.
        """
        for name, checksum in self._begun.files.items():
            yield from self._missing_of(name, self._begun.sizes[name], checksum)

    def _missing_of(self, name: str, size: int, checksum: str) -> Iterator[Chunk]:
        file = file_in(self.folder, name)
        kept = self._arrived(name, size)
        yield from chunks_of(name, size, kept)
        if kept and checksum_of(file) != checksum:  # what was kept may be at fault
            self.there -= chunk_count(size)
            yield from chunks_of(name, size)
        if checksum_of(file) != checksum:
            file.unlink()
            raise MapError(
                f"{self._path}: {name} arrives with a wrong checksum: the map is damaged where it "
                "is served; build it again there"
            )

    def add(self, chunk: Chunk, data: bytes) -> None:
        """Write a chunk, as long as it says; those of a file come in order."""
        file = file_in(self.folder, chunk.file)
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("r+b" if chunk.number else "wb") as opened:
            opened.seek(CHUNK * chunk.number)
            opened.write(data)
        self.there += 1

    def finish(self) -> Map:
        """Put the map in its place when all chunks are there; return it, opened.

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
        """Leave what has arrived for the next time; a folder in which nothing has is removed."""
        if self._offer is None and not (self.folder / MANIFEST).exists():
            shutil.rmtree(self.folder)

    @property
    def _begun(self) -> Offer:
        assert self._offer is not None, "begin first"
        return self._offer

    def _arrived(self, name: str, size: int) -> int:
        """How many whole chunks of a file are there, right or not."""
        file = file_in(self.folder, name)
        length = file.stat().st_size if file.is_file() else 0
        return chunk_count(size) if length == size else min(length, size - 1) // CHUNK

    def _check_room(self, needed: int) -> None:
        free = shutil.disk_usage(self.folder).free
        if needed > free:
            raise MapError(
                f"{self._path}: {_mib(needed)} MiB are still to come and the disk has room for "
                f"{_mib(free)}; free some space, or choose another folder with --to"
            )

    def _empty(self) -> None:
        for entry in self.folder.iterdir():
            if entry.is_dir() and not entry.is_symlink():
                shutil.rmtree(entry)
            elif entry.name != _LOCK:
                entry.unlink()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which goes with the process however it ends."""
    lock = folder / _LOCK
    with lock.open("ab") as opened:
        # it may be of a folder that has just been put in its place by the one who held it
        is_held = (
            take_lock(opened)
            and lock.exists()
            and os.path.samestat(os.fstat(opened.fileno()), lock.stat())
        )
        if not is_held:
            raise MapError(f"{folder}: is being fetched already; let that end, and try again")
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
