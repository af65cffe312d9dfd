"""Where on earth the metres of a map are."""

from pathlib import Path

from placefield.errors import MapError
from placefield.maps.geography import Origin


def origin_of(pose_frame: str | None, path: Path, instead: str) -> Origin:
    """Return the origin of the frame that the poses of a map are in.

    Args:
        pose_frame: of the map; none if it has no poses.
        path: which map that is.
        instead: what else can be done where it is nowhere on earth.

    Raises:
        MapError: it is nowhere on earth.
    """
    origin = Origin.of_frame(pose_frame)
    if origin is None:
        what = "it has no poses" if pose_frame is None else f"its poses are in {pose_frame!r}"
        raise MapError(
            f"{path}: is nowhere on earth, for {what}; build it of frames with latitude and "
            f"longitude, in a frames.csv or in the photographs' EXIF data, or {instead}"
        )
    return origin
