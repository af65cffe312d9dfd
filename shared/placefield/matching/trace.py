"""What the filter keeps of a frame for the smoother."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.motion import Array
from placefield.matching.odometry import Displacement

Vector = NDArray[np.float64]

NEGLIGIBLE = 1e-6
"""A belief below this is left out: no sum of a few of them changes a match."""

MOST_PLACES = 512
"""Places of most belief that the smoother knows of a frame."""


class ObservedTransition(NamedTuple):
    """The transition to a frame, and the frame's observation at the n places of its trace.

    Attributes:
        places: (n,) int32, ascending.
        observed: (2, n) float32, likelihood ratio of the frame at each place to that when lost, for
            a vehicle that was there already, and for one that has come there.
        prior: (S,) float32, of the speeds in the transition to the frame.
        step: length of the step to the frame, or ``UNKNOWN``.
        lost_likelihood: (S,) float64, likelihood of that step for a lost vehicle.
        jump: the same for a vehicle that jumps.
        all_places: K, how many places the map had.
    """

    places: NDArray[np.int32]
    observed: Array
    prior: Array
    step: float
    lost_likelihood: Vector
    jump: float
    all_places: int


class Trace(NamedTuple):
    """What the smoother needs of a frame.

    Attributes:
        transit: the transition to the frame, at n places.
        belief: (n, 2, S) float32, posterior on the map and on its reverse.
        lost: (S,) float64, posterior of being lost, at each speed.
        displacement: of the step to the frame; None if the transition goes by the speeds.
        observed: whether the frame was observed.
    """

    transit: ObservedTransition
    belief: Array
    lost: Vector
    displacement: Displacement | None
    observed: bool

    @property
    def places(self) -> NDArray[np.int32]:
        """The places in the trace, (n,) int32, ascending."""
        return self.transit.places
