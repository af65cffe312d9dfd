"""Times and positions of photographs, from their EXIF data."""

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
    """Time and position of a photograph; None if it is missing or cannot be read.

    Attributes:
        stamp_ns: DateTimeOriginal with its fraction and offset; UTC if there is no offset.
        degrees: latitude and longitude.
    """

    stamp_ns: int | None = None
    degrees: Position | None = None


def read_geotag(path: Path) -> Geotag:
    """Read the tags of a photograph, without its pixels."""
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:
            if image.format == "PNG" and "exif" not in image.info:
                return Geotag()  # Pillow would read all pixels to search behind them
            exif = image.getexif()
            when, where = exif.get_ifd(ExifTags.IFD.Exif), exif.get_ifd(ExifTags.IFD.GPSInfo)
    except Exception:  # Pillow raises errors of any kind; a damaged image is reported when read
        return Geotag()
    return Geotag(_stamp_ns(when), _degrees(where))


def list_photographs(folder: Path, files: Sequence[str], default_stamp_ns: DefaultStamp) -> Listing:
    """List photographs with the stamps and poses of their tags, in the order of the stamps.

    If nearly all files have a stamp, the stamps give the order, and equal stamps keep the order of
    the names. It is logged if the two orders differ. A file without a stamp gets that of the file
    before it by name, and follows it. Otherwise the names give the order, and frame i's stamp is
    ``default_stamp_ns(i)``; signs that this order is wrong are logged. The yaw is the direction of
    travel.

    Args:
        folder: of the files.
        files: names, in natural sort order.
        default_stamp_ns: gives the nominal stamp of a frame by its number.
    """
    warn_of_copies(folder, files)
    tags = _tags(folder, files)
    times = [tag.stamp_ns for tag in tags]
    if len(set(times)) == 1:  # equal times of all files give no order
        times = [None] * len(times)
    known = len(times) - times.count(None)
    if known == 0 or known < _NEARLY_ALL * len(times):
        if known:
            log.warning(
                "%s: only %d of %d photographs have a time: the order is that of the names",
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
            "%s: the names are not in the order of the photographs' times (frame %d is %s, not "
            "%s): the times are used; to overrule them, write a frames.csv",
            folder,
            first,
            files[order[first]],
            files[first],
        )
    frames = [Listed(files[at], stamps[at]) for at in order]
    return with_positions(frames, [tags[at].degrees for at in order], in_degrees=True)


def _tags(folder: Path, files: Sequence[str]) -> list[Geotag]:
    """Read the tags of all files if a sample has any: a camera tags all photographs, or none."""
    few = {len(files) * part // _LOOKED_AT for part in range(_LOOKED_AT)} | {len(files) - 1}
    if all(_tag(folder / files[at]) == Geotag() for at in few):
        return [Geotag()] * len(files)
    return [_tag(folder / file) for file in files]


def _filled(times: Sequence[int | None]) -> list[int]:
    """Replace a missing time by the one before it, or at the start by the first known one."""
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
    offset = str(tags.get(base.OffsetTimeOriginal, "")).strip("\0 :")  # blanks mean unknown
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
    """Return signed degrees from degrees, minutes and seconds, and the side (N, S, E or W)."""
    try:
        degrees, minutes, seconds = map(float, value)
        sign = (1, -1)[list(sides).index(side)]
    except (TypeError, ValueError, ArithmeticError):
        return None
    angle = degrees + minutes / 60 + seconds / 3600
    return sign * angle if math.isfinite(angle) and 0 <= angle <= most else None
