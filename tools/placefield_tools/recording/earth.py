"""Where on earth the metres of a map are."""

from pathlib import Path

from placefield.errors import MapError
from placefield.maps.geography import Origin


def origin_of(pose_frame: str | None, path: Path) -> Origin:
    """Return the origin of the frame that the poses of a map are in; ``path`` says which map.

    Raises:
        MapError: it is nowhere on earth.
    """
    origin = Origin.of_frame(pose_frame)
    if origin is None:
        what = "has no poses" if pose_frame is None else f"has poses in {pose_frame!r}"
        raise MapError(
            f"{path}: {what}, not on earth; build it of frames with latitude and longitude, "
            "in a frames.csv or in the photographs' EXIF data"
        )
    return origin
