"""A folder of image files as a source of frames."""

import logging
import os
import threading
from collections.abc import Iterator
from pathlib import Path

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.common.natural_sort import in_natural_order
from placefield_tools.sources.frames_csv import read_frames_csv
from placefield_tools.sources.geotags import list_photographs
from placefield_tools.sources.listing import Listing, nominal_stamp_ns
from placefield_tools.sources.regular_files import check_file
from placefield_tools.sources.source import Source, until

log = logging.getLogger(__name__)

IMAGE_SUFFIXES = (".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp")
LISTING = "frames.csv"


class Folder(Source):
    """The images of one folder, without its sub-folders, still encoded.

    With a ``frames.csv``, the frames are the files that it lists (see ``frames_csv``). Without one,
    they are all files with the suffix of an image, in the order of their EXIF times (see
    ``geotags``), or else in natural sort order (frame2 before frame10) at ``NOMINAL_RATE``. Hidden
    files do not count, because some systems put one beside each image.
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
        listing = _listing(path)
        self.origin = listing.origin
        self.stamped = listing.stamped
        self._path = path
        self._frames = listing.frames
        self.span = listing.span
        self._chosen = listing.chosen(start, stride, path)
        self.count = len(self._chosen)

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; each file is read when its frame is due, and not decoded."""
        for index in until(self._stop, self._chosen):
            listed = self._frames[index]
            image = self._read(listed.file)
            name = f"{self._path.name}/{listed.file}"
            yield Frame(index, listed.stamp_ns, name, image, listed.pose, listed.odometry_m)

    def _read(self, file: str) -> bytes:
        try:
            return (self._path / file).read_bytes()
        except OSError as error:
            raise SourceError(f"{self._path / file}: cannot be read ({error.strerror})") from error


def _listing(folder: Path) -> Listing:
    table = folder / LISTING
    files = in_natural_order(
        file.name
        for file in folder.iterdir()
        if file.suffix.lower() in IMAGE_SUFFIXES
        and not file.name.startswith(".")
        and not file.is_dir()
    )
    if os.path.lexists(table):
        check_file(table)
        listing = read_frames_csv(table, nominal_stamp_ns)
        if left_out := {*files} - {frame.file for frame in listing.frames}:
            log.warning("%s: leaves out %d of %d images", table, len(left_out), len(files))
        return listing
    if not files:
        raise SourceError(f"{folder}: no image files ({' '.join(IMAGE_SUFFIXES)}) in this folder")
    for file in files:  # no file may be skipped, because that would shift all later places
        check_file(folder / file)
    return list_photographs(folder, files, nominal_stamp_ns)
