"""Descriptors of another program as a source of frames."""

import csv
import logging
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.errors import SourceError
from placefield.features.frames import Frame, GivenDescriptor
from placefield_tools.common.natural_sort import in_natural_order
from placefield_tools.sources.descriptor_files import (
    NUMPY_SUFFIXES,
    DescriptorArray,
    read_descriptors,
)
from placefield_tools.sources.folder import IMAGE_SUFFIXES, LISTING
from placefield_tools.sources.frames_csv import read_frames_csv
from placefield_tools.sources.listing import Listed, Listing, nominal_stamp_ns
from placefield_tools.sources.source import Source, until

log = logging.getLogger(__name__)

_BOTH_SIDES = {"database_descriptors.npy", "queries_descriptors.npy"}
"""What VPR-methods-evaluation writes into one folder."""


class Descriptors(Source):
    """The descriptors in a file, or in the files of a folder, as frames without images.

    A file is read as ``descriptor_files`` says; a table of its name, ``NAME.csv`` beside
    ``NAME.npy``, gives stamps and poses, a row for each descriptor. In a folder, the files that
    its ``frames.csv`` lists have one descriptor each. Without a ``frames.csv``, all ``.npy`` and
    ``.npz`` files are read in natural sort order, each with any number of descriptors. Frames
    without stamps have nominal ones (see ``listing``).

    A descriptor that is not finite is a frame with a fault.
    """

    def __init__(
        self,
        path: Path,
        *,
        start: int = 0,
        stride: int = 1,
        stop: threading.Event | None = None,
    ) -> None:
        self._stop = stop
        (self._names, self._vectors), listing = _folder(path) if path.is_dir() else _file(path)
        self._frames = listing.frames
        self.origin, self.stamped, self.span = listing.origin, listing.stamped, listing.span
        self._vectors = np.asarray(self._vectors)  # a row of a memmap takes much longer to make
        self.dimensions = self._vectors.shape[1]
        self._chosen = listing.chosen(start, stride, path)
        self.count = len(self._chosen)

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; descriptors of float64 become float32."""
        for index in until(self._stop, self._chosen):
            listed = self._frames[index]
            vector = _as_given(self._vectors[index])
            fault = "" if np.isfinite(vector).all() else "the descriptor is not finite"
            yield Frame(
                index,
                listed.stamp_ns,
                self._names[index],
                b"",
                listed.pose,
                listed.odometry_m,
                fault,
                None if fault else vector,
            )


def holds_descriptors(folder: Path) -> bool:
    """Return whether the frames of a folder are descriptors.

    They are if its ``frames.csv`` begins with a file of one. Without a ``frames.csv``, they are if
    the folder has such files and no images.
    """
    table = folder / LISTING
    if table.is_file():
        return Path(_first_listed(table)).suffix.lower() in NUMPY_SUFFIXES
    has_images = any(file.suffix.lower() in IMAGE_SUFFIXES for file in folder.iterdir())
    return not has_images and bool(_files(folder))


def _first_listed(table: Path) -> str:
    """Return the first file that a table lists; nothing if the table is malformed."""
    try:
        with table.open(encoding="utf-8-sig", newline="") as lines:
            row = next(csv.DictReader(lines), {})
    except (OSError, UnicodeDecodeError, csv.Error):
        return ""
    return row.get("file") or ""


def _file(path: Path) -> tuple[DescriptorArray, Listing]:
    read, table = read_descriptors(path), path.with_suffix(".csv")
    if not table.is_file():
        return read, _without_table(len(read.vectors))
    listing = read_frames_csv(table, nominal_stamp_ns, of_files=False)
    if len(listing.frames) != len(read.vectors):
        raise SourceError(
            f"{table}: has {len(listing.frames)} rows, and {path.name} has {len(read.vectors)} "
            "descriptors; give a row for each, or rename the table"
        )
    return read, listing


def _folder(folder: Path) -> tuple[DescriptorArray, Listing]:
    table = folder / LISTING
    if table.is_file():
        listing = read_frames_csv(table, nominal_stamp_ns)
        each = [_only_one(folder / frame.file) for frame in listing.frames]
        return _joined(folder, [frame.file for frame in listing.frames], each), listing
    files = _files(folder)
    if {*files} >= _BOTH_SIDES:
        raise SourceError(f"{folder}: holds two drives; give {' and '.join(sorted(_BOTH_SIDES))}")
    parts = [read_descriptors(folder / file, one=True) for file in files]
    several = [file for file, part in zip(files, parts, strict=True) if len(part.vectors) > 1]
    if len(several) > 1:
        log.warning("%s: its files are one drive: %s first", folder, files[0])
    read = _joined(folder, files, parts)
    return read, _without_table(len(read.vectors))


def _files(folder: Path) -> list[str]:
    return in_natural_order(
        file.name
        for file in folder.iterdir()
        if file.suffix.lower() in NUMPY_SUFFIXES and not file.name.startswith(".")
    )


def _only_one(file: Path) -> DescriptorArray:
    read = read_descriptors(file, one=True)
    if len(read.vectors) > 1:
        raise SourceError(
            f"{file}: has {len(read.vectors)} descriptors; a file that {LISTING} lists has one"
        )
    return read


def _joined(
    folder: Path, files: Sequence[str], parts: Sequence[DescriptorArray]
) -> DescriptorArray:
    expected = parts[0].vectors.shape[1]
    for file, part in zip(files, parts, strict=True):
        if part.vectors.shape[1] != expected:
            raise SourceError(
                f"{folder / file}: descriptors of {part.vectors.shape[1]} dimensions, and those of "
                f"{files[0]} have {expected}"
            )
    names = [
        f"{folder.name}/{file if len(part.vectors) == 1 else name}"
        for file, part in zip(files, parts, strict=True)
        for name in part.names
    ]
    return DescriptorArray(names, np.concatenate([part.vectors for part in parts]))


def _without_table(count: int) -> Listing:
    return Listing([Listed("", nominal_stamp_ns(at)) for at in range(count)], stamped=False)


def _as_given(vector: NDArray[np.floating[Any]]) -> GivenDescriptor:
    """Return it as float16 or float32; a number too large for float32 becomes infinite.

    It stays in the file's memory where possible, so that of many descriptors there is no copy.
    """
    with np.errstate(over="ignore"):
        if vector.dtype.itemsize == 2:
            return np.asarray(vector, np.float16)
        return np.asarray(vector, np.float32)
