"""Positions in degrees to metres, from the first of them."""

import math

import numpy as np
from numpy.typing import NDArray

from placefield.maps.geography import Origin


def is_fix(latitude: float, longitude: float) -> bool:
    """Return whether degrees are a position: 0, 0 is none, but how receivers say they have no fix.

    Nor is NaN.
    """
    finite = math.isfinite(latitude) and math.isfinite(longitude)
    return finite and not latitude == longitude == 0


def to_local_metres(degrees: NDArray[np.float64]) -> tuple[Origin, NDArray[np.float64]]:
    """Lay positions out on the plane that touches the earth at the first.

    Args:
        degrees: (N, 2) latitude and longitude; N is 1 or more.

    Returns:
        The origin, to the digits that a map's ``pose_frame`` holds, and (N, 2) metres.

    Raises:
        ValueError: a position is nowhere on earth.
    """
    wrong = np.flatnonzero((np.abs(degrees) > (90, 180)).any(axis=1))
    if len(wrong):
        latitude, longitude = degrees[wrong[0]]
        raise ValueError(f"latitude {latitude:g}, longitude {longitude:g} is nowhere on earth")
    latitude, longitude = np.round(degrees[0], 9)
    origin = Origin(float(latitude), float(longitude))
    return origin, np.array([origin.to_local(*position) for position in degrees])
