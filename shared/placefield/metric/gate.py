"""The gate: does a learned metric recognise places better than the identity does?

It is asked on held-back frames, as another traverse saw them and as the reference itself did. A
metric may be fitted to what differs between two traverses, or to one of them, and recognise a third
worse; on the sample routes only those that gain in every margin below did not.

Rendering the held-back frames in other light, focus or position cannot stand in for another
traverse: metrics that gained on those recognised real queries worse.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.metric.distances import squared_distances

TOLERANCE = 4
"""How far from the truth a place is still right: traverses are aligned that well, frames."""

_BLOCK = 128  # probes whose distances are held at once

Array = NDArray[np.float32]
Truth = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Probes:
    """Held-back frames as other traverses saw them, and the places to look them up among.

    Attributes:
        places: (K, N) float32, descriptors of one reference traverse.
        descriptors: (P, N) float32, of the probes.
        truth: (P,) int, the place of each probe.

    """

    places: Array
    descriptors: Array
    truth: Truth


@dataclass(frozen=True)
class Margins:
    """How clearly frames find their places; positive exactly where the nearest one is right.

    For distances t to the nearest place within `TOLERANCE` of the truth and f to the nearest place
    further off, the contrast is (f − t) / (f + t) and the standardised margin (f − t) / σ, with σ
    the deviation of the frame's distances over all places. Evidence is in such deviations, so that
    the second is what a frame adds to a match. Both are 0 where all distances are equal or no place
    is further off, and neither changes with the projection's scale.

    Attributes:
        contrast: (P,) float32 in [-1, 1], of the probes.
        standardised: (P,) float32, of the probes.
        own_contrast: (H,) float32, of the H distinct places asked for, as the reference saw them,
            looked up without themselves.

    """

    contrast: Array
    standardised: Array
    own_contrast: Array


def passes_gate(projection: Array, probes: Probes) -> bool:
    """Tell whether a projection, (M, N) float32, recognises places better than the identity.

    Each of the margins must gain, by a mean above twice its standard error.
    """
    learned, identity = margins(projection, probes), margins(None, probes)
    return (
        _is_gain(learned.contrast - identity.contrast)
        and _is_gain(learned.standardised - identity.standardised)
        and _is_gain(learned.own_contrast - identity.own_contrast)
    )


def probe_score(projection: Array | None, probes: Probes) -> float:
    """Score a metric by the probes' mean standardised margin; 0 where there are no probes."""
    right, wrong, deviation = _among(*_projected(projection, probes), probes.truth)
    return float(_ratio(wrong - right, deviation).sum()) / max(len(probes.truth), 1)


def margins(projection: Array | None, probes: Probes) -> Margins:
    """Compute all margins under a projection, (M, N) float32; None is the identity."""
    places, descriptors = _projected(projection, probes)
    right, wrong, deviation = _among(places, descriptors, probes.truth)
    own = np.unique(probes.truth)
    own_right, own_wrong, _ = _among(places, places[own], own, but_own=True)
    return Margins(
        _ratio(wrong - right, wrong + right),
        _ratio(wrong - right, deviation),
        _ratio(own_wrong - own_right, own_wrong + own_right),
    )


def _projected(projection: Array | None, probes: Probes) -> tuple[Array, Array]:
    """Places and probes, centred and projected."""
    centre = probes.places.mean(axis=0)
    places, descriptors = probes.places - centre, probes.descriptors - centre
    if projection is None:
        return places, descriptors
    return places @ projection.T, descriptors @ projection.T


def _among(places: Array, asked: Array, truth: Truth, *, but_own: bool = False) -> Array:
    """What `_nearest` says of the probes, and the deviation of their distances: (3, Q)."""
    parts = []
    for block in blocks(len(asked), _BLOCK):
        distances = squared_distances(asked[block], places)
        if but_own:
            distances[np.arange(len(distances)), truth[block]] = np.inf
            deviation = np.zeros(len(distances))
        else:
            deviation = distances.std(axis=1)
        parts.append(np.stack([*_nearest(distances, truth[block]), deviation]))
    return np.concatenate([np.empty((3, 0), places.dtype), *parts], axis=1).astype(places.dtype)


def _nearest(distances: Array, truth: Truth) -> Array:
    """Distances to the nearest right and wrong place, (2, Q); 0 and 0 if there is no wrong.

    Those to the right ones are overwritten, for a mask of all would be as large again.
    """
    nearest = np.empty((2, len(distances)), distances.dtype)
    for row, place, found in zip(distances, truth, nearest.T, strict=True):
        right = row[max(place - TOLERANCE, 0) : place + TOLERANCE + 1]
        found[0] = right.min()
        right[:] = np.inf
        found[1] = row.min()
    nearest[:, ~np.isfinite(nearest).all(axis=0)] = 0
    return nearest


def _ratio(part: Array, whole: Array) -> Array:
    ratio = np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)
    return np.asarray(ratio, np.float32)


def _is_gain(gains: Array) -> bool:
    if len(gains) < 2:
        return False
    return bool(gains.mean() > 2 * gains.std(ddof=1) / np.sqrt(len(gains)))
