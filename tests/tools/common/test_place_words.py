import numpy as np

from placefield.maps.route_graph import NO_LINKS, RouteGraph, line
from placefield_tools.common.place_words import place_words


def test_a_place_is_named_with_its_route_if_there_are_several() -> None:
    town = RouteGraph(("A", "B"), np.array([0, 90], np.int32), NO_LINKS)
    assert place_words(110, town) == "B, place 20"
    assert place_words(89, town) == "A, place 89"
    assert place_words(110, line("A")) == place_words(110, None) == "place 110"
    assert place_words(-1, town) == "no place"
