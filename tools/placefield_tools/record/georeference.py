"""The georeference of a map's poses."""

from pathlib import Path

from placefield.errors import MapError
from placefield.maps.geography import Origin


def origin_of(pose_frame: str | None, path: Path, instead: str) -> Origin:
    """Return the origin of the coordinate frame of a map's poses.

    Args:
        pose_frame: of the map; None if it has no poses.
        path: of the map, used in the error.
        instead: the alternative that the error names.

    Raises:
        MapError: the map is not georeferenced.
    """
    origin = Origin.of_frame(pose_frame)
    if origin is None:
        what = "it has no poses" if pose_frame is None else f"its poses are in {pose_frame!r}"
        raise MapError(
            f"{path}: is not georeferenced: {what}; build it of frames with latitude and "
            f"longitude, in a frames.csv or in the photographs' EXIF data, or {instead}"
        )
    return origin
