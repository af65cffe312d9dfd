"""Maps of several routes with links between them: saved, opened, and refused if unsound."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from placefield.config import Config
from placefield.errors import MapError
from placefield.maps.build import build_map
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.route_graph import NO_LINKS, RouteGraph
from placefield.maps.store import save_map

LINKS = np.array([[29, 60], [59, 30], [89, 0]], np.int32)


def graph_of(first: list[int], links: object = NO_LINKS) -> RouteGraph:
    names = tuple(f"road {number}" for number in range(len(first)))
    return RouteGraph(names, np.array(first, np.int32), np.array(links, np.int32))


@pytest.fixture
def built(make_traverse: Callable[..., object]) -> Map:
    config = Config.model_validate({"metric": {"kind": "identity"}, "scales": {"channels": 2}})
    return build_map([make_traverse()], config)  # type: ignore[list-item]


def test_routes_and_links_are_opened_as_they_were_saved(built: Map, tmp_path: Path) -> None:
    save_map(replace(built, graph=graph_of([0, 30, 60], LINKS)), tmp_path / "a.pfmap")
    graph = open_map(tmp_path / "a.pfmap").graph
    assert graph.names == ("road 0", "road 1", "road 2")
    assert graph.first.tolist() == [0, 30, 60]
    assert graph.links.tolist() == LINKS.tolist()
    assert [graph.route_of(place) for place in (0, 29, 30, 59, 60, 89)] == [0, 0, 1, 1, 2, 2]
    assert not graph.is_line


def test_a_map_of_one_traverse_is_a_line(built: Map, tmp_path: Path) -> None:
    save_map(built, tmp_path / "a.pfmap")
    opened = open_map(tmp_path / "a.pfmap")
    assert opened.graph.is_line
    assert opened.graph.names == (opened.traverses[0].name,)
    assert not (tmp_path / "a.pfmap" / "graph").exists()


@pytest.mark.parametrize(
    ("first", "links", "reason"),
    [
        ([0, 90], NO_LINKS, "a route has no place"),
        ([0, 50], [[0, 90]], "a link leads to no place"),
        ([0, 50], [[-1, 3]], "a link leads to no place"),
        ([0, 50], [[49, 0], [49, 0]], "not distinct"),
        ([0, 50], [[49, 0], [20, 70]], "not distinct and in ascending order"),
        ([0, 50], [[20, 21]], "to the next one of its route"),
    ],
)
def test_an_unsound_graph_is_refused(
    built: Map, tmp_path: Path, first: list[int], links: object, reason: str
) -> None:
    if first == [0, 90]:  # such a map cannot be saved: the manifest refuses a route of no places
        with pytest.raises(ValueError, match="places"):
            save_map(replace(built, graph=graph_of(first)), tmp_path / "a.pfmap")
        return
    save_map(replace(built, graph=graph_of(first, links)), tmp_path / "a.pfmap")
    with pytest.raises(MapError, match=f"routes and links: .*{reason}.*build the map again"):
        open_map(tmp_path / "a.pfmap")
