"""The place of a match in words."""

from placefield.maps.route_graph import RouteGraph


def place_words(place: int, graph: RouteGraph | None) -> str:
    """Name a matched place, with its route if the map has several.

    Args:
        place: of the map; negative without a match.
        graph: of the map; None if it is not known.
    """
    if place < 0:
        return "no place"
    return f"place {place}" if graph is None else graph.named(place)
