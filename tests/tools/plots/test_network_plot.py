"""The picture of a network: where routes stand that have no poses."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from placefield.maps.linking import Overlap
from placefield.maps.route_graph import NO_LINKS, RouteGraph
from placefield_tools.plots import DrawnNetwork, plot_network
from placefield_tools.plots.network import schematic

NOWHERE = np.empty((0, 2))


def graph_of(*links: tuple[int, int]) -> RouteGraph:
    array = np.array(links, np.int32) if links else NO_LINKS
    return RouteGraph(("A", "B", "C"), np.array([0, 90, 180], np.int32), array)


def test_a_route_stands_below_the_stretch_that_it_shares_or_behind_the_link_to_it() -> None:
    overlap = Overlap(95, 119, 65, 89)
    at = schematic(DrawnNetwork(graph_of((179, 180)), [overlap], NOWHERE, 260))
    assert at[[0, 89]].tolist() == [[0, 0], [89, 0]]
    assert at[[90, 95, 119]].tolist() == [[60, -1], [65, -1], [89, -1]]
    assert at[180].tolist() == [at[179, 0] + 1, -2]


def test_routes_that_nothing_joins_begin_at_the_left() -> None:
    at = schematic(DrawnNetwork(graph_of(), [], NOWHERE, 260))
    assert at[[0, 90, 180], 0].tolist() == [0, 0, 0]


@pytest.mark.parametrize("count", [0, 260], ids=["schematic", "poses"])
def test_links_are_drawn(tmp_path: Path, count: int) -> None:
    positions = np.column_stack([np.arange(count), np.arange(count) // 90 * 30.0])
    pictures = []
    for number, graph in enumerate((graph_of(), graph_of((89, 90)))):
        path = tmp_path / f"{number}.png"
        plot_network(path, DrawnNetwork(graph, [], positions, 260))
        pictures.append(np.asarray(Image.open(path).convert("RGB"), np.int32))
    orange = [(abs(each - [213, 94, 0]).max(axis=2) < 30).sum() for each in pictures]
    assert orange[0] == 0 < orange[1]
