"""Trajectories in the TUM format, which evo reads: ``stamp tx ty tz qx qy qz qw``."""

import math
from decimal import Decimal

from placefield_tools.export.matched_traverse import QueryTraverse


def to_tum(traverse: QueryTraverse) -> str:
    """Write a line for each match: stamp in seconds, position in metres, rotation."""
    lines = []
    for localised in traverse.matches:
        stamp = Decimal(localised.header.stamp_ns).scaleb(-9)  # exactly, unlike a float
        x, y, yaw = localised.pose
        lines.append(f"{stamp:f} {x} {y} 0 0 0 {math.sin(yaw / 2)} {math.cos(yaw / 2)}\n")
    return "".join(lines)
