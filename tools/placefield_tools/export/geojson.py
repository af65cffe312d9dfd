"""Trajectories and matches as GeoJSON (RFC 7946)."""

import json
from collections.abc import Sequence
from typing import Any

from placefield_tools.export.matched_traverse import QueryTraverse
from placefield_tools.record.records import as_object

_PROPERTIES = ("stream", "sequence", "stamp_ns", "place", "score", "probability", "known")


def to_geojson(traverse: QueryTraverse) -> str:
    """Write a point for each match, and a line along them if there are two or more.

    Raises:
        MapError: the map is not georeferenced.
    """
    positions = [[longitude, latitude] for latitude, longitude in traverse.geographic_positions()]
    features = [
        _feature("Point", position, as_object(localised.header, localised.match))
        for position, localised in zip(positions, traverse.matches, strict=True)
    ]
    if len(positions) > 1:
        whole = {"stream": traverse.matches[0].header.stream}
        features.insert(0, _feature("LineString", positions, whole))
    return json.dumps({"type": "FeatureCollection", "features": features}) + "\n"


def _feature(kind: str, coordinates: Sequence[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": {name: properties[name] for name in _PROPERTIES if name in properties},
    }
