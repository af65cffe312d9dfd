"""What the filter observes of a frame."""

from typing import NamedTuple

from placefield.matching.motion import Array
from placefield.matching.odometry import Displacement


class Observation(NamedTuple):
    """What the filter observes of a frame.

    Attributes:
        step: distance from the frame before, in descriptor space, or ``UNKNOWN``.
        displacement: since the frame before; None if the odometry is not known.
        novelty: how much the frame differs from the frame before, 0 to 1.
        evidence: (K,) float32, nats by which the frame is likelier at each place of the shard than
            when lost.
        lost_evidence: nats by which the frame is likelier when lost than at an average place.
    """

    step: float
    displacement: Displacement | None
    novelty: float
    evidence: Array
    lost_evidence: float
