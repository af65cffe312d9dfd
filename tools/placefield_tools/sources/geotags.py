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

log = logging.getLogger(__name__)

_SUFFIXES = (".jpeg", ".jpg")


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
            exif = image.getexif()
            when, where = exif.get_ifd(ExifTags.IFD.Exif), exif.get_ifd(ExifTags.IFD.GPSInfo)
    except Exception:  # Pillow raises whatever comes up; a damaged image is told of when it is read
        return Geotag()
    return Geotag(_stamp_ns(when), _degrees(where))


def list_photographs(folder: Path, files: Sequence[str], default_stamp_ns: DefaultStamp) -> Listing:
    """List files with the stamps and poses that their tags hold.

    The stamps count where all files have one and they never go back, which is logged if not;
    otherwise frame i's is ``default_stamp_ns(i)``. The yaws are the direction of travel.
    """
    tags = [_tag(folder / file) for file in files]
    stamps = [tag.stamp_ns for tag in tags if tag.stamp_ns is not None]
    stamped = len(stamps) == len(tags) and stamps == sorted(stamps)
    if not stamped:
        if stamps:
            log.warning("%s: the photographs' times are not in their order: left out", folder)
        stamps = [default_stamp_ns(at) for at in range(len(files))]
    frames = [Listed(file, stamp_ns) for file, stamp_ns in zip(files, stamps, strict=True)]
    listing = with_positions(frames, [tag.degrees for tag in tags], in_degrees=True)
    return replace(listing, stamped=stamped)


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
