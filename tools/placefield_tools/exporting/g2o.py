"""Loop closures as a pose graph that g2o, GTSAM and others read.

The vertices are the places of the map, held fixed, and the query frames that were matched; the
edges are between a frame and its place. What the vehicle drove between two frames is not known
here: those edges are for whoever has the odometry to add. Vertex ids are the places' indices, then
from the number of places on the frames' sequence numbers.
"""

import math
from collections.abc import Iterator

import numpy as np

from placefield_tools.exporting.traverse import QueryTraverse

_HIGHEST_PROBABILITY = 1 - 1e-6
_PROBABILITY_UNTOLD = 0.5
_LEAST_RADIUS_M = 0.1  # however close the places: no map's poses are better known
_HEADING_RAD = math.radians(15)  # a place that is looked at from further aside looks different


def to_g2o(traverse: QueryTraverse) -> str:
    """Write the graph."""
    return "".join(f"{line}\n" for line in _lines(traverse))


def _lines(traverse: QueryTraverse) -> Iterator[str]:
    count = len(traverse.places)
    radius = _radius(traverse)
    for place, (x, y, yaw) in enumerate(traverse.places.tolist()):
        yield f"VERTEX_SE2 {place} {x} {y} {yaw}"
        yield f"FIX {place}"
    for localised in traverse.matches:
        x, y, yaw = localised.pose
        frame = count + localised.header.sequence
        along, heading = _information(localised.match.probability, radius)
        yield f"VERTEX_SE2 {frame} {x} {y} {yaw}"
        yield (f"EDGE_SE2 {localised.match.place} {frame} 0 0 0 {along} 0 0 {along} 0 {heading}")


def _radius(traverse: QueryTraverse) -> float:
    """Return how far from its place a frame of a right match may be, metres."""
    steps = np.hypot(*np.diff(traverse.places[:, :2], axis=0).T)
    spacing = float(np.mean(steps)) if len(steps) else 0.0
    return max(_LEAST_RADIUS_M, (traverse.tolerance + 0.5) * spacing)


def _information(probability: float | None, radius: float) -> tuple[float, float]:
    """Return the information on x and y, 1/m², and on yaw, 1/rad².

    It is that of a normal distribution in the plane which is within the radius with the match's
    probability p: 1 - exp(-r²/2σ²) = p.
    """
    likely = _PROBABILITY_UNTOLD if probability is None else probability
    certainty = -2 * math.log1p(-min(likely, _HIGHEST_PROBABILITY))
    return certainty / radius**2, certainty / _HEADING_RAD**2
