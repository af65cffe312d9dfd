"""Parts of traverses."""

from dataclasses import replace

from placefield.maps.traverse import Traverse


def part(traverse: Traverse, name: str, frames: slice) -> Traverse:
    """Return some frames of a traverse as one of another name."""
    return replace(
        traverse,
        name=name,
        raw=traverse.raw[frames],
        stamps=traverse.stamps[frames],
        poses=traverse.poses[frames],
        travelled=traverse.travelled[frames],
        thumbnails=traverse.thumbnails[frames],
    )
