"""The files of a map's folder: each is checked before it is used."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.array_files import ArrayFile, ArrayHeader, open_inside
from placefield.maps.array_layout import Layout
from placefield.maps.checksums import checksum_of_opened
from placefield.maps.manifest import REBUILD, Manifest

_QUICK = 2**28  # bytes: up to this length, a wrong checksum is reported before a wrong shape
# The longest file that is accepted; the largest files hold some kB per place.
_MOST_BYTES = 2**30
_MOST_BYTES_OF_A_PLACE = 2**16


class MapFiles:
    """The arrays of a map's folder."""

    def __init__(self, path: Path, manifest: Manifest) -> None:
        """Prepare to read the arrays that the manifest of the map at ``path`` lists."""
        self.path, self.manifest = path, manifest
        self._watched: list[tuple[Path, ArrayFile]] = []

    def load(self, folder: str, layout: Layout, sizes: dict[str, int]) -> list[NDArray[Any]]:
        """Load the arrays of a folder of the map.

        Args:
            folder: its path in the map.
            layout: of its arrays.
            sizes: the known lengths of axes; new ones are added.

        Raises:
            MapError: a file is missing, damaged, or has another dtype or shape.
        """
        arrays = []
        for name, (dtype, axes) in layout.items():
            arrays.append(self._open(f"{folder}/{name}.npy", dtype, axes, sizes))
        return arrays

    def _open(self, name: str, dtype: str, axes: str, sizes: dict[str, int]) -> NDArray[Any]:
        file = self.path / name
        try:
            content = open_inside(self.path, name)
            opened = ArrayFile(content)
            header = opened.header()
            problem = self._problem(opened, header, dtype, axes, sizes)
            if problem is not None and opened.length > _QUICK:
                raise MapError(f"{file}: {problem}; {REBUILD}")
            if checksum_of_opened(content) != self.manifest.files.get(name):
                raise MapError(f"{file}: damaged: its checksum is wrong; {REBUILD}")
            if header is None or problem is not None:
                raise MapError(f"{file}: {problem}; {REBUILD}")
            array = opened.array(header)
        except OSError:
            raise MapError(f"{file}: missing or unreadable; {REBUILD}") from None
        if opened.is_mapped:
            self._watched.append((file, opened))
        else:
            opened.close()
        return array

    def _problem(
        self,
        opened: ArrayFile,
        header: ArrayHeader | None,
        dtype: str,
        axes: str,
        sizes: dict[str, int],
    ) -> str | None:
        """Describe what is wrong with an array, by its header alone: the file may be huge."""
        if header is None:
            return "not an array"
        if header.dtype != dtype or not _fits(header.shape, axes, sizes):
            return "does not fit the other files"
        if opened.length > _MOST_BYTES + _MOST_BYTES_OF_A_PLACE * self.manifest.places:
            return "too long for so many places"
        return None

    def check_unchanged(self) -> None:
        """See ``Map.check_unchanged``."""
        for file, opened in self._watched:
            if not opened.is_unchanged:
                raise MapError(f"{file}: was written to while in use; {REBUILD}")


def _fits(shape: tuple[int, ...], axes: str, sizes: dict[str, int]) -> bool:
    return len(shape) == len(axes) and all(
        sizes.setdefault(axis, length) == length for axis, length in zip(axes, shape, strict=True)
    )
