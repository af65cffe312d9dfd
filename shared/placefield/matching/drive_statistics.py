"""What the filter learns along a drive, from about the last hundred frames."""

import math

import numpy as np
from numpy.typing import NDArray

from placefield.kernels import kernel, pairwise_sum
from placefield.matching.motion import Array

Vector = NDArray[np.float64]

_FORGET = 0.99  # of a frame's weight is left at the next
_UNLEARNED = 10.0  # frames that the prior counts as
_BASE = 0.2  # part of the prior of speeds that is not learned
_LEAST_LOST = 0.75  # nats per frame by which the best place beats an average one by chance
_TYPICAL = 1.5  # nats per frame by which a passed place beats an average one
_LEAST_RATIO = 1e-6  # one frame of another place must not outweigh the others
_LOST_FRACTION = 0.55  # a lost vehicle's evidence, as a fraction of that of the passed places


class DriveStatistics:
    """Statistics of a drive: its speeds, and how well its frames resemble the places."""

    def __init__(self, prior: Vector) -> None:
        """Begin a drive with this prior of its speeds, (S,)."""
        self._prior = prior
        self._speeds = np.zeros_like(prior)
        self._deviations, self._frames = 0.0, 0.0
        self._evidence, self._weight = 0.0, 0.0

    @property
    def prior(self) -> Array:
        """Chance of each speed after a change, (S,), learned: a drive keeps its frame rate."""
        return _learned(self._prior, self._speeds)

    @property
    def lost_evidence(self) -> float:
        """Nats per frame by which a frame is likelier when lost than at an average place.

        It is about half of the evidence that the passed places had. So a vehicle that recognises
        the route well is soon found to have left it.
        """
        evidence = self._evidence + _TYPICAL * _UNLEARNED
        return max(_LEAST_LOST, _LOST_FRACTION * evidence / (self._weight + _UNLEARNED))

    def deviation(self, deviation: float) -> float:
        """Add the newest frame's deviation of distances, and return the mean of all frames."""
        self._deviations = _FORGET * self._deviations + deviation
        self._frames = _FORGET * self._frames + 1
        return self._deviations / self._frames

    def learn(self, speeds: Vector, was_on_map: float, ratio: float, novelty: float) -> None:
        """Learn from a frame.

        Args:
            speeds: (S,), posterior of each speed on the map.
            was_on_map: posterior that the vehicle was on the map before the frame.
            ratio: how many times likelier the frame was at the predicted places than at an average
                one.
            novelty: of the frame, 0 to 1.
        """
        self._speeds = _FORGET * self._speeds + speeds
        nats = math.log(max(ratio, _LEAST_RATIO))
        self._evidence = _FORGET * self._evidence + was_on_map * novelty * nats
        self._weight = _FORGET * self._weight + was_on_map * novelty


@kernel
def _learned(prior: Vector, speeds: Vector) -> Array:
    """Return the chance of each speed, (S,) float32, from the prior and the speeds so far."""
    count = pairwise_sum(speeds)
    if count == 0:
        return prior.astype(np.float32)
    learned = (1 - _BASE) * count / (count + _UNLEARNED)
    return ((1 - learned) * prior + learned * speeds / count).astype(np.float32)
