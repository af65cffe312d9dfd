"""Loop closures as a pose graph for g2o, GTSAM and others.

The vertices are the places of the map that have a pose, which are fixed, and the matched query
frames. The edges connect a frame with its place. Edges between frames are not written: add them
from the odometry. The ID of a place is its index; the ID of a frame is its sequence number plus the
number of places.
"""

import math
from collections.abc import Iterator

from placefield.bus.messages import MatchMessage
from placefield.fusion.uncertainty import pose_variances
from placefield_tools.export.matched_traverse import QueryTraverse

_DEFAULT_PROBABILITY = 0.5


def to_g2o(traverse: QueryTraverse) -> str:
    """Write the graph."""
    return "".join(f"{line}\n" for line in _lines(traverse))


def _lines(traverse: QueryTraverse) -> Iterator[str]:
    count, fixed = len(traverse.places), []
    for place, (x, y, yaw) in enumerate(traverse.places.tolist()):
        if not math.isfinite(x + y + yaw):
            continue
        fixed.append(place)
        yield f"VERTEX_SE2 {place} {x} {y} {yaw}"
    for localised in traverse.matches:
        x, y, yaw = localised.pose
        frame = count + localised.header.sequence
        along, heading = _information(traverse, localised.match)
        yield f"VERTEX_SE2 {frame} {x} {y} {yaw}"
        yield (f"EDGE_SE2 {localised.match.place} {frame} 0 0 0 {along} 0 0 {along} 0 {heading}")
    for place in fixed:  # at the end: GTSAM reads no edge after such a line
        yield f"FIX {place}"


def _information(traverse: QueryTraverse, match: MatchMessage) -> tuple[float, float]:
    """Return the information on x and y, 1/m², and on yaw, 1/rad²."""
    probability = _DEFAULT_PROBABILITY if match.probability is None else match.probability
    xy, yaw = pose_variances(traverse.places, match.place, traverse.tolerance, probability)
    return 1 / xy, 1 / yaw
