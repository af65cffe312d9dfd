"""Guess what kind of source a person means."""

import math
import re
from collections.abc import Callable
from pathlib import Path

from placefield.errors import SourceError
from placefield_tools.sources.camera import Camera
from placefield_tools.sources.folder import IMAGE_SUFFIXES, Folder
from placefield_tools.sources.metered import Metered
from placefield_tools.sources.source import Source
from placefield_tools.sources.spaced import Spaced
from placefield_tools.sources.video import Video

_CAMERA = re.compile(r"(?:camera:|/dev/video)(\d+)", re.ASCII)


def open_source(
    where: str,
    *,
    start: int = 0,
    stride: int = 1,
    spacing_m: float | None = None,
    metres: Callable[[], float | None] | None = None,
) -> Source:
    """Open a folder of images, a video file, or a camera (``camera:0`` or ``/dev/video0``).

    The source gives the frames ``start``, ``start + stride``, …, and of these, if asked to, only
    one every ``spacing_m`` metres (see ``Spaced``), of a camera by what ``metres`` tells.

    Raises SourceError where nothing of the kind is there, where it cannot be read, or where
    ``start``, ``stride`` or ``spacing_m`` does not fit. A video tells only when it is read that it
    ends before ``start``: its container's count may be wrong.
    """
    if start < 0:
        raise SourceError(f"--start {start}: must be 0 or more")
    if stride < 1:
        raise SourceError(f"--stride {stride}: must be 1 or more")
    if spacing_m is not None and not (math.isfinite(spacing_m) and spacing_m > 0):
        raise SourceError(f"--spacing {spacing_m:g}: must be a distance above 0 metres")
    source = _open(where, start, stride)
    if spacing_m is None:
        return source
    if source.live and metres is not None:
        source = Metered(source, metres)
    return Spaced(source, spacing_m)


def _open(where: str, start: int, stride: int) -> Source:
    if camera := _CAMERA.fullmatch(where):
        return Camera(int(camera[1]), start=start, stride=stride)
    try:
        return _open_path(Path(where), start, stride)
    except OSError as error:
        raise SourceError(f"{where}: cannot be read ({error.strerror})") from error


def _open_path(path: Path, start: int, stride: int) -> Source:
    if path.is_dir():
        return Folder(path, start=start, stride=stride)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise SourceError(f"{path}: this would be one image; give the folder that it lies in")
    if path.is_file():
        return Video(path, start=start, stride=stride)
    raise SourceError(
        f"{path}: no such folder or file; give a folder of images, a video, or camera:0"
    )
