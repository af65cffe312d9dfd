"""Conversion of positions in degrees to metres from the first position."""

import math

import numpy as np
from numpy.typing import NDArray

from placefield.maps.geography import Origin


def is_fix(latitude: float, longitude: float) -> bool:
    """Return whether degrees are a position.

    NaN is none, and neither is 0, 0, which receivers give without a fix.
    """
    finite = math.isfinite(latitude) and math.isfinite(longitude)
    return finite and not latitude == longitude == 0


def to_local_metres(degrees: NDArray[np.float64]) -> tuple[Origin, NDArray[np.float64]]:
    """Convert positions to metres on the tangent plane at the first position.

    Args:
        degrees: (N, 2) latitude and longitude; N is 1 or more.

    Returns:
        The origin, with the precision of a map's ``pose_frame``, and (N, 2) metres east and north.

    Raises:
        ValueError: a latitude is beyond ±90 degrees, or a longitude beyond ±180.
    """
    wrong = np.flatnonzero((np.abs(degrees) > (90, 180)).any(axis=1))
    if len(wrong):
        latitude, longitude = degrees[wrong[0]]
        raise ValueError(
            f"latitude {latitude:g}, longitude {longitude:g}: beyond 90 or 180 degrees"
        )
    latitude, longitude = np.round(degrees[0], 9)
    origin = Origin(float(latitude), float(longitude))
    return origin, np.array([origin.to_local(*position) for position in degrees])
