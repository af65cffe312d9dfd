"""The pose graph, by the words of its lines."""

import dataclasses
import math
from collections import defaultdict

import numpy as np
import pytest

from placefield_tools.export.g2o import to_g2o
from placefield_tools.export.matched_traverse import QueryTraverse

Graph = dict[str, list[list[float]]]


def parse(text: str) -> Graph:
    graph: Graph = defaultdict(list)
    for line in text.splitlines():
        tag, *numbers = line.split(" ")
        graph[tag].append(list(map(float, numbers)))
    return graph


@pytest.fixture
def graph(traverse: QueryTraverse) -> Graph:
    return parse(to_g2o(traverse))


def test_vertices_are_the_places_held_fixed_and_the_matched_frames_at_theirs(
    graph: Graph, traverse: QueryTraverse
) -> None:
    vertices = {int(number): pose for number, *pose in graph["VERTEX_SE2"]}
    assert list(vertices) == [0, 1, 2, 3, 4, 5, 6, 8]
    np.testing.assert_array_equal([vertices[place] for place in range(5)], traverse.places)
    assert [vertices[5], vertices[6], vertices[8]] == [vertices[1], vertices[2], vertices[4]]
    assert graph["FIX"] == [[place] for place in range(5)]


def test_fixed_vertices_come_last_because_gtsam_reads_no_edge_after_them(
    traverse: QueryTraverse,
) -> None:
    tags = [line.split(" ")[0] for line in to_g2o(traverse).splitlines()]
    assert set(tags[tags.index("FIX") :]) == {"FIX"}


def test_an_edge_is_from_each_matched_place_to_its_frame(graph: Graph) -> None:
    assert [tuple(edge[:5]) for edge in graph["EDGE_SE2"]] == [
        (1, 5, 0, 0, 0),
        (2, 6, 0, 0, 0),
        (4, 8, 0, 0, 0),
    ]
    for edge in graph["EDGE_SE2"]:
        assert len(edge) == 11
        xx, xy, xt, yy, yt, tt = edge[5:]
        assert xy == xt == yt == 0
        assert min(np.linalg.eigvalsh([[xx, 0, 0], [0, yy, 0], [0, 0, tt]])) > 0


def test_the_information_puts_the_matchs_probability_within_its_reach(
    graph: Graph, traverse: QueryTraverse
) -> None:
    """A million draws of the distribution that an edge says."""
    rng = np.random.default_rng(5)
    for edge, probability in zip(graph["EDGE_SE2"], (0.995, 1, 0.5), strict=True):
        place = int(edge[0])
        near = traverse.places[max(0, place - 2) : place + 3, :2] - traverse.places[place, :2]
        offsets = rng.normal(scale=1 / math.sqrt(edge[5]), size=(1_000_000, 2))
        within = np.mean(np.hypot(*offsets.T) <= np.hypot(*near.T).max())
        assert within == pytest.approx(probability, abs=2e-3)


def test_the_information_is_finite_where_the_places_are_all_one(traverse: QueryTraverse) -> None:
    at_one = dataclasses.replace(traverse, places=traverse.places[[2] * 5])
    graph = parse(to_g2o(at_one))
    assert np.isfinite(graph["EDGE_SE2"]).all()


def test_a_place_without_a_pose_is_no_vertex(traverse: QueryTraverse) -> None:
    places = traverse.places.copy()
    places[[0, 3]] = np.nan
    text = to_g2o(dataclasses.replace(traverse, places=places))
    assert "nan" not in text
    assert parse(text)["FIX"] == [[1], [2], [4]]
