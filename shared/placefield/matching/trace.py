"""What the filter leaves of a frame for the smoother."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import Array
from placefield.matching.odometry import Way

Vector = NDArray[np.float64]

NEGLIGIBLE = 1e-6
"""A belief below this is left out: no sum of a few of them changes a match."""

MOST_PLACES = 512
"""Places of most belief that the smoother knows of a frame."""


class Transit(NamedTuple):
    """How a frame was come to, and what it showed in n places that were believed in.

    Attributes:
        places: (n,) int32, ascending.
        observed: (2, n) float32, by how much likelier the frame is at each than when lost, for a
            vehicle that was there already, and for one that has come there.
        prior: (S,) float32, of the speeds in the transition to the frame.
        step: length of the step to it, or ``UNKNOWN``.
        lost_likelihood: (S,) float64, likelihood of that step for a lost vehicle.
        jump: likewise for one that jumps.
    """

    places: NDArray[np.int32]
    observed: Array
    prior: Array
    step: float
    lost_likelihood: Vector
    jump: float


class Trace(NamedTuple):
    """What the smoother needs of a frame.

    Attributes:
        transit: to the frame; n places.
        belief: (n, 2, S) float32, posterior on the map and on its reverse.
        lost: (S,) float64, posterior of being lost, at each speed.
        way: of the step to the frame, None if it goes by the speeds.
        observed: whether the frame showed anything.
    """

    transit: Transit
    belief: Array
    lost: Vector
    way: Way | None
    observed: bool

    @property
    def places(self) -> NDArray[np.int32]:
        """Places that were believed in, (n,) int32, ascending."""
        return self.transit.places


def most(belief: Array, places: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return those of these places that are among the ``MOST_PLACES`` of most belief, ascending."""
    if len(places) <= MOST_PLACES:
        return places
    first = np.argsort(-belief[places], kind="stable")[:MOST_PLACES]
    return np.sort(places[first])
