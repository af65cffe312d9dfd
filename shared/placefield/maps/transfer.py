"""Transfer of a map from host to host: the offer, and the chunks of its files.

Neither side trusts the other: only files that the manifest lists, in the map's folder, are sent.
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
"""Length of a chunk, bytes; the last chunk of a file may be shorter."""

_FILE = re.compile(r"([A-Za-z0-9_]{1,64}/){1,8}[A-Za-z0-9_]{1,64}\.npy")


@dataclass(frozen=True)
class Chunk:
    """A piece of a file of a map: ``length`` bytes from the offset ``number`` times ``CHUNK``."""

    file: str
    number: int
    length: int


def chunks_of(file: str, size: int, start: int = 0) -> Iterator[Chunk]:
    """Yield the chunks of a file of ``size`` bytes, from number ``start`` on."""
    for number in range(start, chunk_count(size)):
        yield Chunk(file, number, min(CHUNK, size - CHUNK * number))


def chunk_count(size: int) -> int:
    """Return how many chunks a file of ``size`` bytes has."""
    return -(-size // CHUNK)


def digest_of(data: bytes) -> str:
    """Return the SHA-256 of a chunk or of a manifest, hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def name_of(path: Path) -> str:
    """Return the name by which other hosts fetch a map: its folder's name without the suffix.

    Raises:
        MapError: the path has no name.
    """
    name = path.absolute().name.removesuffix(SUFFIX)
    if not name:
        raise MapError(f"{path}: a map's name ends in {SUFFIX}")
    return name


def check_file(name: str) -> None:
    """Refuse a file name that no map has; an accepted name cannot lead out of the folder.

    Raises:
        MapError: the name is refused.
    """
    if not _FILE.fullmatch(name):
        raise MapError(f"{name!r:.80}: no file of a map has such a name")


def file_in(folder: Path, name: str) -> Path:
    """Return the path of a file of a map.

    Raises:
        MapError: no file of a map has such a name, or a part of its path is a link.
    """
    check_file(name)
    file = folder / name
    for part in (file, *file.parents[: name.count("/")]):
        if part.is_symlink():
            raise MapError(f"{part}: is a link; the files of a map lie in its folder")
    return file


@dataclass(frozen=True)
class Offer:
    """The offer of a map by a host that has it.

    Attributes:
        written: the bytes of its manifest.
        sizes: of its files, bytes.
    """

    written: bytes
    sizes: Mapping[str, int]

    @cached_property
    def digest(self) -> str:
        """The SHA-256 of the manifest, which identifies the map."""
        return digest_of(self.written)

    @cached_property
    def files(self) -> Mapping[str, str]:
        """Checksums of the files.

        Raises:
            MapError: the manifest is malformed, or of another format.
        """
        return parse_manifest(self.written, MANIFEST).files

    @property
    def chunks(self) -> int:
        """Number of chunks of all files."""
        return sum(map(chunk_count, self.sizes.values()))

    def check(self) -> None:
        """Refuse an offer that no honest host makes.

        Raises:
            MapError: the manifest is malformed, too long or of another format, lists a name that no
                file of a map has, or lists other files than the sizes.
        """
        if len(self.written) > LONGEST_MANIFEST:
            raise MapError(f"{MANIFEST}: more than {LONGEST_MANIFEST} bytes")
        for name in self.files:
            check_file(name)
        if self.sizes.keys() != self.files.keys() or min(self.sizes.values(), default=0) < 1:
            raise MapError(f"{MANIFEST}: lists other files than the offer")


class OwnMap:
    """A map of this host that other hosts may fetch: its manifest and chunks of its files.

    The map may be rebuilt at any time: each call reads the map that is there at that moment.
    """

    def __init__(self, path: Path) -> None:
        """Check the map at this path.

        Raises:
            MapError: there is no map, or its manifest is damaged.
        """
        self._path = path
        self.name = name_of(path)
        self._manifest = lru_cache(1)(self._parse)
        self.offer()

    def offer(self) -> Offer:
        """Return the offer of the map.

        Raises:
            MapError: there is no map, its manifest is damaged, or a file is missing.
        """
        files = read_manifest(self._path).files
        offer = Offer(self._written(), {name: self._file(name).stat().st_size for name in files})
        offer.check()
        return offer

    def chunk(self, digest: str, file: str, number: int) -> bytes:
        """Return a chunk of a file.

        Raises:
            MapError: the map was replaced, or has no such chunk.
        """
        written = self._written()
        if digest_of(written) != digest:
            raise MapError(f"{self._path}: is not the requested map {digest[:12]!r}")
        if file not in self._manifest(written).files:
            raise MapError(f"{self._path}: this map has no file {file!r:.80}")
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
            raise MapError(f"{self._path}: the map is gone") from None

    def _parse(self, written: bytes) -> Manifest:
        return parse_manifest(written, str(self._path / MANIFEST))

    def _file(self, name: str) -> Path:
        file = file_in(self._path, name)
        if not file.is_file():
            raise MapError(f"{file}: is missing, or is no file")
        return file
