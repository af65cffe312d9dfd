"""The gate: does a learned metric recognise places better than the identity does?

It is asked on probes, frames of known place seen under a change of the kind that a query brings. A
metric that only fits the weather of its own traverse does not pass.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.metric.distances import squared_distances

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Probes:
    """Frames of known place under other conditions, and the places to look them up among.

    Attributes:
        places: (K, N) float32, descriptors of one reference traverse.
        descriptors: (P, N) float32, of the probes: held-back frames of that traverse, perturbed, or
            of another traverse, as they are.
        truth: (P,) int, the place of each probe.

    """

    places: Array
    descriptors: Array
    truth: NDArray[np.integer[Any]]


def passes_gate(projection: Array, probes: Probes, tolerance: int) -> bool:
    """Tell whether a projection, (M, N) float32, finds the probes' places better than the identity.

    The mean gain in `probe_margins` must be above twice its standard error: on the sample routes
    the metrics that gained less did worse on the real query more often than not.
    """
    margins = probe_margins(projection, probes, tolerance)
    gains = margins - probe_margins(None, probes, tolerance)
    if len(gains) < 2:
        return False
    return bool(gains.mean() > 2 * gains.std(ddof=1) / np.sqrt(len(gains)))


def probe_score(projection: Array | None, probes: Probes, tolerance: int) -> float:
    """Score a metric by the mean of `probe_margins`, in [-1, 1]; 0 where there are no probes."""
    return float(probe_margins(projection, probes, tolerance).sum()) / max(len(probes.truth), 1)


def probe_margins(projection: Array | None, probes: Probes, tolerance: int) -> Array:
    """Compute how clearly each probe finds its place, (P,) float32 in [-1, 1].

    A probe's margin is (f − t) / (f + t), where t is its distance to the nearest place within
    `tolerance` places of the truth and f that to the nearest place further off; positive exactly
    where the nearest place of all is right, and 0 where both distances are 0.

    Recall and the area under a precision-recall curve are often the same under two metrics, or 1
    under both; a margin tells them apart at every probe. Being a ratio, it does not change with the
    projection's scale. Of the scores compared on the sample routes (also recall, reciprocal rank,
    areas) its mean ranked metrics most like one-frame recall of the real query did.

    projection (M, N) float32 is the paper's v, None the identity.
    """
    centre = probes.places.mean(axis=0)
    places, descriptors = probes.places - centre, probes.descriptors - centre
    if projection is not None:
        places, descriptors = places @ projection.T, descriptors @ projection.T
    distances = squared_distances(descriptors, places)
    is_right = np.abs(np.arange(len(places)) - probes.truth[:, None]) <= tolerance
    right = distances.min(axis=1, where=is_right, initial=np.inf)
    wrong = distances.min(axis=1, where=~is_right, initial=np.inf)
    total = right + wrong
    margins = np.divide(wrong - right, total, out=np.zeros_like(total), where=total > 0)
    return np.asarray(margins, np.float32)
