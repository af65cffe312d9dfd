"""The gate: it accepts a learned metric only if it recognises places better than the identity.

It compares the two on held-back frames, as another traverse observed them and as the reference
itself did. A metric may be fitted to the difference between two traverses, or to one of them, and
recognise a third traverse worse. On the sample routes no metric that gained in every margin below
did so.

Held-back frames that are rendered in other light, focus or position cannot replace another
traverse: metrics that gained on those recognised real queries worse.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.metric.squared_distances import squared_distances

TOLERANCE = 4
"""Greatest distance of a right place from the truth, frames: traverses are aligned so well."""

_BLOCK = 128  # probes whose distances are held at once

Array = NDArray[np.float32]
Truth = NDArray[np.integer[Any]]


@dataclass(frozen=True)
class Probes:
    """Held-back frames as other traverses observed them, and the places to search them among.

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
    """How clearly frames find their places; positive exactly where the nearest place is right.

    Let t be the distance to the nearest place within `TOLERANCE` of the truth, and f the distance
    to the nearest place further off. The contrast is (f − t) / (f + t), and the standardised margin
    is (f − t) / σ, with σ the deviation of the frame's distances over all places. Evidence is
    measured in such deviations, so the standardised margin is what a frame contributes to a match.
    Both are 0 if all distances are equal or no place is further off, and neither changes with the
    projection's scale.

    Attributes:
        contrast: (P,) float32 in [-1, 1], of the probes.
        standardised: (P,) float32, of the probes.
        own_contrast: (H,) float32, of the H distinct places of the probes, as the reference
            observed them, searched among all places but themselves.
    """

    contrast: Array
    standardised: Array
    own_contrast: Array


def passes_gate(projection: Array, probes: Probes) -> bool:
    """Return whether a projection, (M, N) float32, recognises places better than the identity.

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
    """Return places and probes, centred and projected."""
    centre = probes.places.mean(axis=0)
    places, descriptors = probes.places - centre, probes.descriptors - centre
    if projection is None:
        return places, descriptors
    return places @ projection.T, descriptors @ projection.T


def _among(places: Array, queries: Array, truth: Truth, *, but_own: bool = False) -> Array:
    """Return `_nearest` of the queries, and the deviation of their distances: (3, Q)."""
    parts = []
    for block in blocks(len(queries), _BLOCK):
        distances = squared_distances(queries[block], places)
        if but_own:
            distances[np.arange(len(distances)), truth[block]] = np.inf
            deviation = np.zeros(len(distances))
        else:
            deviation = distances.std(axis=1)
        parts.append(np.stack([*_nearest(distances, truth[block]), deviation]))
    return np.concatenate([np.empty((3, 0), places.dtype), *parts], axis=1).astype(places.dtype)


def _nearest(distances: Array, truth: Truth) -> Array:
    """Return the distances to the nearest right and wrong place, (2, Q); 0 and 0 without a wrong.

    The distances to the right places are overwritten, because a mask would need as much memory.
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
