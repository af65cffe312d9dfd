"""A made-up route of five places, 2 m apart, that turns left."""

import math

import numpy as np

from placefield.maps.geography import Origin

ORIGIN = Origin(47.5, 8.5)
PLACES = np.array(
    [[0, 0, 0], [2, 0, 0], [4, 0, math.pi / 2], [4, 2, math.pi / 2], [4, 4, -math.pi]], float
)
STAMP_NS = 1_700_000_000_123_456_789
