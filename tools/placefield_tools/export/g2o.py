"""Loop closures as a pose graph that g2o, GTSAM and others read.

The vertices are the places of the map that have a pose, held fixed, and the query frames that were
matched; the edges are between a frame and its place. What the vehicle drove between two frames is
not known here: those edges are for whoever has the odometry to add. Vertex ids are the places'
indices, then from the number of places on the frames' sequence numbers.
"""

import math
from collections.abc import Iterator

from placefield.bus.messages import MatchMessage
from placefield.fusion.uncertainty import pose_variances
from placefield_tools.export.matched_traverse import QueryTraverse

_PROBABILITY_UNTOLD = 0.5


def to_g2o(traverse: QueryTraverse) -> str:
    """Write the graph."""
    return "".join(f"{line}\n" for line in _lines(traverse))


def _lines(traverse: QueryTraverse) -> Iterator[str]:
    count = len(traverse.places)
    for place, (x, y, yaw) in enumerate(traverse.places.tolist()):
        if not math.isfinite(x + y + yaw):
            continue
        yield f"VERTEX_SE2 {place} {x} {y} {yaw}"
        yield f"FIX {place}"
    for localised in traverse.matches:
        x, y, yaw = localised.pose
        frame = count + localised.header.sequence
        along, heading = _information(traverse, localised.match)
        yield f"VERTEX_SE2 {frame} {x} {y} {yaw}"
        yield (f"EDGE_SE2 {localised.match.place} {frame} 0 0 0 {along} 0 0 {along} 0 {heading}")


def _information(traverse: QueryTraverse, match: MatchMessage) -> tuple[float, float]:
    """Return the information on x and y, 1/m², and on yaw, 1/rad²."""
    likely = _PROBABILITY_UNTOLD if match.probability is None else match.probability
    xy, yaw = pose_variances(traverse.places, match.place, traverse.tolerance, likely)
    return 1 / xy, 1 / yaw
