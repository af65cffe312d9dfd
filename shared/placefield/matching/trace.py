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


class Trace(NamedTuple):
    """What the smoother needs of a frame: n places that were believed in, and the transition.

    Attributes:
        places: (n,) int32, ascending.
        belief: (n, 2, S) float32, posterior on the map and on its reverse.
        lost: (S,) float64, posterior of being lost, at each speed.
        evidence: (n,) float32, nats by which the frame is likelier at each place than when lost.
        counts: (2,) float32, how much of that counts for a vehicle that was there already, and for
            one that has come there.
        prior: (S,) float32, of the speeds in the transition to this frame.
        step: length of the step to it, or ``UNKNOWN``.
        way: of the step, None if it goes by the speeds.
        stray: (S,) float64, likelihood of that step for a lost vehicle.
        jump: likewise for one that jumps.
        observed: whether the frame showed anything.
    """

    places: NDArray[np.int32]
    belief: Array
    lost: Vector
    evidence: Array
    counts: Array
    prior: Array
    step: float
    way: Way | None
    stray: Vector
    jump: float
    observed: bool


def most(belief: Array, places: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return those of these places that are among the ``MOST_PLACES`` of most belief, ascending."""
    if len(places) <= MOST_PLACES:
        return places
    first = np.argsort(-belief[places], kind="stable")[:MOST_PLACES]
    return np.sort(places[first])
