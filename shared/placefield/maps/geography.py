"""Conversion between latitude and longitude and a map's metres, on a local tangent plane.

x is east and y is north of the plane's origin, on the ellipsoid of WGS 84 (pymap3d's ENU). Height
is ignored: the ground is 8 m below the plane at 10 km from the origin.
"""

import re
from dataclasses import dataclass
from typing import Self

import pymap3d  # type: ignore[import-untyped]

from placefield.errors import MapError

_NUMBER = r"(-?[0-9]{1,3}\.[0-9]{1,9})"
_FRAME = re.compile(rf"wgs84 {_NUMBER} {_NUMBER}")


@dataclass(frozen=True)
class Origin:
    """The point where the tangent plane touches the ellipsoid, degrees north and east."""

    latitude: float
    longitude: float

    def to_local(self, latitude: float, longitude: float) -> tuple[float, float]:
        """Return x and y, metres, of a point given in degrees."""
        east, north, _ = pymap3d.geodetic2enu(
            latitude, longitude, 0.0, self.latitude, self.longitude, 0.0
        )
        return float(east), float(north)

    def to_degrees(self, x: float, y: float) -> tuple[float, float]:
        """Return latitude and longitude, degrees, of a point given in metres."""
        latitude, longitude, _ = pymap3d.enu2geodetic(
            x, y, _drop(x, y), self.latitude, self.longitude, 0.0
        )
        return float(latitude), float(longitude)

    @property
    def frame(self) -> str:
        """The name of this coordinate frame in a map: ``wgs84 LATITUDE LONGITUDE``."""
        return f"wgs84 {self.latitude:.9f} {self.longitude:.9f}"

    @classmethod
    def of_frame(cls, frame: str | None) -> Self | None:
        """Read the origin from a frame's name; None if the frame is not georeferenced.

        Raises:
            MapError: the name begins with ``wgs84`` and holds no valid latitude and longitude.
        """
        if frame is None or not frame.startswith("wgs84 "):
            return None
        found = _FRAME.fullmatch(frame)
        if found is None or abs(float(found[1])) > 90 or abs(float(found[2])) > 180:
            raise MapError(f"poses in {frame!r}: give 'wgs84 LATITUDE LONGITUDE', in degrees")
        return cls(float(found[1]), float(found[2]))


def _drop(x: float, y: float) -> float:
    """Return the height of the ground below the plane, metres (negative), for the way back."""
    radius = 6_371_000.0
    return -(x * x + y * y) / (2 * radius)
