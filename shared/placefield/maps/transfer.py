"""A map on its way from host to host: what is offered, and the chunks it is cut into.

Neither side trusts the other: a file is one that the manifest lists, and lies in the map's folder.
"""

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

from placefield.errors import MapError
from placefield.maps.array_files import open_inside
from placefield.maps.manifest import (
    LONGEST_MANIFEST,
    MANIFEST,
    SUFFIX,
    Manifest,
    parse_manifest,
    read_manifest,
)

CHUNK = 2**20
"""Bytes of a file that travel together; less at its end."""

_FILE = re.compile(r"([A-Za-z0-9_]{1,64}/){1,8}[A-Za-z0-9_]{1,64}\.npy")


@dataclass(frozen=True)
class Chunk:
    """So many bytes of a file of a map, from ``CHUNK`` times its number on."""

    file: str
    number: int
    length: int


def chunks_of(file: str, size: int, start: int = 0) -> Iterator[Chunk]:
    """Yield the chunks of a file of so many bytes, from number ``start`` on."""
    for number in range(start, chunk_count(size)):
        yield Chunk(file, number, min(CHUNK, size - CHUNK * number))


def chunk_count(size: int) -> int:
    """Return how many chunks a file of so many bytes has."""
    return -(-size // CHUNK)


def digest_of(data: bytes) -> str:
    """Return the SHA-256 of a chunk, or of a manifest: which map it is; hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def name_of(path: Path) -> str:
    """Return the name by which others ask for a map: its folder's, without the suffix.

    Raises:
        MapError: it has none.
    """
    name = path.absolute().name.removesuffix(SUFFIX)
    if not name:
        raise MapError(f"{path}: a map's name ends in {SUFFIX}")
    return name


def check_file(name: str) -> None:
    """Refuse a name that no file of a map has; there is no way out of a folder by one that passes.

    Raises:
        MapError: it is none.
    """
    if not _FILE.fullmatch(name):
        raise MapError(f"{name!r:.80}: no file of a map has such a name")


def file_in(folder: Path, name: str) -> Path:
    """Return where a file of a map lies.

    Raises:
        MapError: no file of a map has such a name, or a link is on the way to it.
    """
    check_file(name)
    file = folder / name
    for part in (file, *file.parents[: name.count("/")]):
        if part.is_symlink():
            raise MapError(f"{part}: is a link; the files of a map lie in its folder")
    return file


@dataclass(frozen=True)
class Offer:
    """A map as one who has it offers it.

    Attributes:
        written: its manifest, byte for byte.
        sizes: of its files, bytes.
    """

    written: bytes
    sizes: Mapping[str, int]

    @cached_property
    def digest(self) -> str:
        """Which map it is."""
        return digest_of(self.written)

    @cached_property
    def files(self) -> Mapping[str, str]:
        """Checksums of the files.

        Raises:
            MapError: the manifest is none, or is of another format.
        """
        return parse_manifest(self.written, MANIFEST).files

    @property
    def chunks(self) -> int:
        """How many chunks its files have."""
        return sum(map(chunk_count, self.sizes.values()))

    def check(self) -> None:
        """Refuse what no honest host offers.

        Raises:
            MapError: the manifest is none, too long or of another format; it lists what is no file
                of a map; the sizes are not of these files.
        """
        if len(self.written) > LONGEST_MANIFEST:
            raise MapError(f"{MANIFEST}: more than {LONGEST_MANIFEST} bytes")
        for name in self.files:
            check_file(name)
        if self.sizes.keys() != self.files.keys() or min(self.sizes.values(), default=0) < 1:
            raise MapError(f"{MANIFEST}: lists other files than are offered")


class OwnMap:
    """A map that this host has, as others may have it: its manifest and chunks of its files.

    It may be built again at any time: every question is about the map that is there then.
    """

    def __init__(self, path: Path) -> None:
        """Have the map at this path.

        Raises:
            MapError: there is none, or its manifest is damaged.
        """
        self._path = path
        self.name = name_of(path)
        self._manifest = lru_cache(1)(self._parse)
        self.offer()

    def offer(self) -> Offer:
        """Offer the map.

        Raises:
            MapError: there is none, its manifest is damaged or a file missing.
        """
        files = read_manifest(self._path).files
        offer = Offer(self._written(), {name: self._file(name).stat().st_size for name in files})
        offer.check()
        return offer

    def chunk(self, digest: str, file: str, number: int) -> bytes:
        """Return a chunk of a file.

        Raises:
            MapError: the map is another one now, or has no such chunk.
        """
        written = self._written()
        if digest_of(written) != digest:
            raise MapError(f"{self._path}: not the map {digest[:12]!r} that is asked for")
        if file not in self._manifest(written).files:
            raise MapError(f"{self._path}: {file!r:.80} is no file of this map")
        with self._file(file).open("rb") as opened:
            opened.seek(CHUNK * number)
            data = opened.read(CHUNK)
        if not data:
            raise MapError(f"{self._path}: {file} has no chunk {number}")
        return data

    def _written(self) -> bytes:
        try:
            with open_inside(self._path, MANIFEST) as opened:
                return opened.read(LONGEST_MANIFEST + 1)
        except OSError:
            raise MapError(f"{self._path}: no map there any more") from None

    def _parse(self, written: bytes) -> Manifest:
        return parse_manifest(written, str(self._path / MANIFEST))

    def _file(self, name: str) -> Path:
        file = file_in(self._path, name)
        if not file.is_file():
            raise MapError(f"{file}: missing, or no file")
        return file
