"""When and where photographs were taken, by what their camera wrote into them (EXIF)."""

import logging
import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from PIL import ExifTags, Image

from placefield_tools.sources.degrees import is_fix
from placefield_tools.sources.listing import (
    DefaultStamp,
    Listed,
    Listing,
    Position,
    with_positions,
)
from placefield_tools.sources.name_order import warn_of_copies, warn_of_wrap

log = logging.getLogger(__name__)

_SUFFIXES = (".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")

_NEARLY_ALL = 0.9
_LOOKED_AT = 8


class Geotag(NamedTuple):
    """When and where; what the camera did not write, or not so that it can be read, is None.

    Attributes:
        stamp_ns: DateTimeOriginal with its fraction and offset; UTC where it has none.
        degrees: latitude and longitude.
    """

    stamp_ns: int | None = None
    degrees: Position | None = None


def read_geotag(path: Path) -> Geotag:
    """Read a photograph's tags, and not its pixels."""
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:
            if image.format == "PNG" and "exif" not in image.info:
                return Geotag()  # Pillow would read the pixels to look behind them
            exif = image.getexif()
            when, where = exif.get_ifd(ExifTags.IFD.Exif), exif.get_ifd(ExifTags.IFD.GPSInfo)
    except Exception:  # Pillow raises whatever comes up; a damaged image is told of when it is read
        return Geotag()
    return Geotag(_stamp_ns(when), _degrees(where))


def list_photographs(folder: Path, files: Sequence[str], default_stamp_ns: DefaultStamp) -> Listing:
    """List files with the stamps and poses that their tags hold, in the order of the stamps.

    These decide where nearly all files have one, equal ones leaving the order of the names; that
    the two differ is logged. A file without one comes right after the file before it in the order
    of the names, at its time. Else frame i's stamp is ``default_stamp_ns(i)``, and what the names
    say against their order is logged. The yaws are the direction of travel.

    Args:
        folder: of the files.
        files: in the order of their names.
        default_stamp_ns: of a frame by its number.
    """
    warn_of_copies(folder, files)
    tags = _tags(folder, files)
    times = [tag.stamp_ns for tag in tags]
    if len(set(times)) == 1:  # one time for all says nothing of their order
        times = [None] * len(times)
    known = len(times) - times.count(None)
    if known == 0 or known < _NEARLY_ALL * len(times):
        if known:
            log.warning(
                "%s: %d of %d photographs say when they were taken: the names are their order",
                folder,
                known,
                len(times),
            )
        warn_of_wrap(folder, files)
        frames = [Listed(file, default_stamp_ns(at)) for at, file in enumerate(files)]
        listing = with_positions(frames, [tag.degrees for tag in tags], in_degrees=True)
        return replace(listing, stamped=False)
    stamps = _filled(times)
    order = sorted(range(len(files)), key=lambda at: stamps[at])
    if order != list(range(len(files))):
        first = next(at for at, number in enumerate(order) if at != number)
        log.warning(
            "%s: the names are not in the order in which the photographs were taken (frame %d is "
            "%s, and not %s): the times count; a frames.csv would overrule them",
            folder,
            first,
            files[order[first]],
            files[first],
        )
    frames = [Listed(files[at], stamps[at]) for at in order]
    return with_positions(frames, [tags[at].degrees for at in order], in_degrees=True)


def _tags(folder: Path, files: Sequence[str]) -> list[Geotag]:
    """Read the tags of all files, where some of a few have any: a camera tags all, or none."""
    few = {len(files) * part // _LOOKED_AT for part in range(_LOOKED_AT)} | {len(files) - 1}
    if all(_tag(folder / files[at]) == Geotag() for at in few):
        return [Geotag()] * len(files)
    return [_tag(folder / file) for file in files]


def _filled(times: Sequence[int | None]) -> list[int]:
    """Give what has no time that of the one before it, and the first ones that of the first."""
    last = next(time for time in times if time is not None)
    filled = []
    for time in times:
        last = last if time is None else time
        filled.append(last)
    return filled


def _tag(path: Path) -> Geotag:
    return read_geotag(path) if path.suffix.lower() in _SUFFIXES else Geotag()


def _stamp_ns(tags: dict[int, Any]) -> int | None:
    base = ExifTags.Base
    offset = str(tags.get(base.OffsetTimeOriginal, "")).strip("\0 :")  # blanks say: unknown
    fraction = str(tags.get(base.SubsecTimeOriginal, "")).strip("\0 ")
    try:
        when = datetime.strptime(
            f"{tags.get(base.DateTimeOriginal)}{offset or '+00:00'}", "%Y:%m:%d %H:%M:%S%z"
        )
    except ValueError:
        return None
    nanoseconds = int(fraction.ljust(9, "0")[:9]) if fraction.isdecimal() else 0
    stamp_ns = int(when.timestamp()) * 1_000_000_000 + nanoseconds
    return stamp_ns if stamp_ns >= 0 else None


def _degrees(tags: dict[int, Any]) -> Position | None:
    gps = ExifTags.GPS
    latitude = _angle(tags.get(gps.GPSLatitude), tags.get(gps.GPSLatitudeRef), "NS", 90)
    longitude = _angle(tags.get(gps.GPSLongitude), tags.get(gps.GPSLongitudeRef), "EW", 180)
    if latitude is None or longitude is None or not is_fix(latitude, longitude):
        return None
    is_void = str(tags.get(gps.GPSStatus, "")).strip("\0 ") == "V"  # the receiver had no fix
    return None if is_void else (latitude, longitude)


def _angle(value: Any, side: Any, sides: str, most: float) -> float | None:
    """Return degrees, of degrees, minutes and seconds on one of two sides."""
    try:
        degrees, minutes, seconds = map(float, value)
        sign = (1, -1)[list(sides).index(side)]
    except (TypeError, ValueError, ArithmeticError):
        return None
    angle = degrees + minutes / 60 + seconds / 3600
    return sign * angle if math.isfinite(angle) and 0 <= angle <= most else None
