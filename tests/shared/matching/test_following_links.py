"""The filter on drives over the links of made-up maps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from comparisons import compared
from filters import filter_of, posterior_of
from numpy.typing import NDArray
from route_networks import network

from placefield.config import Config, MatchingConfig
from placefield.errors import ConfigError
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.maps.alignment import channel_without_segments
from placefield.maps.map import Map
from placefield.maps.map_metrics import identity_metric, steps_along, with_graph
from placefield.maps.topology import Topology
from placefield.matching.best_window import vicinity_of
from placefield.matching.channel_stage import ChannelStage
from placefield.matching.matcher import Matcher
from placefield.recognizer import Recognizer

Array = NDArray[np.float32]
COUNT, DIMENSIONS = 90, 24
CIRCUIT = network(COUNT, links=[(COUNT - 1, 0)])
FORK = network(COUNT, [0, 60], [(29, 60)])
"""After place 29, the road goes on to place 30, or on another route."""


def views() -> Array:
    """Of a circuit: each is near the one before it."""
    rng = np.random.default_rng(1)
    walk = np.zeros((2 * COUNT, DIMENSIONS))
    noise = np.tile(rng.normal(size=(COUNT, DIMENSIONS)), (2, 1))
    for place in range(1, 2 * COUNT):
        walk[place] = 0.8 * walk[place - 1] + 0.6 * noise[place]
    lap = walk[COUNT:]
    return np.asarray(lap / np.linalg.norm(lap, axis=1, keepdims=True), np.float32)


def matcher_on(topology: Topology) -> Matcher:
    metric = identity_metric(views())
    steps = steps_along(metric.places, metric.unit, topology.graph)
    return filter_of(replace(metric, steps=steps), topology=topology)


def matches_of(topology: Topology, places: Sequence[int]) -> tuple[list[Match], list[Match]]:
    """Causal and smoothed matches of a drive along these places."""
    noise = np.random.default_rng(2).normal(scale=0.4 / DIMENSIONS**0.5, size=(300, DIMENSIONS))
    frames = (views()[list(places)] + noise[: len(places)]).astype(np.float32)
    frames /= np.linalg.norm(frames, axis=1, keepdims=True)
    matcher, near = matcher_on(topology), vicinity_of(topology, 3)
    config, metric = MatchingConfig(), identity_metric(views())
    candidates, smoothed = [], []
    for frame in compared(metric, [*frames]):
        candidates.append(matcher.update(frame))
        smoothed += matcher.smoothed()
    smoothed += matcher.finish()
    return (
        [fuse([candidate], config, near) for candidate in candidates],
        [fuse([each.candidate], config, near) for each in smoothed],
    )


def right(matches: Sequence[Match], way: Sequence[int]) -> list[bool]:
    """Return which matches are known, and within a place of the vehicle."""
    return [
        bool(match.known) and abs(match.place - place) <= 1
        for match, place in zip(matches, way, strict=True)
    ]


def test_on_a_circuit_a_vehicle_stays_known_lap_after_lap() -> None:
    laps = [*range(40, COUNT), *range(COUNT), *range(40)]
    seam = COUNT - 40
    for matches in matches_of(CIRCUIT, laps):
        assert np.mean(right(matches, laps)[10:]) > 0.97
        assert all(match.known for match in matches[10:])
    causal, _ = matches_of(network(COUNT), laps)
    assert not any(right(causal, laps)[seam : seam + 2])


@pytest.mark.parametrize("first", [30, 60])
def test_a_vehicle_stays_known_on_either_way_from_a_fork(first: int) -> None:
    way = [*range(5, 30), *range(first, first + 25)]
    for matches in matches_of(FORK, way):
        assert np.mean(right(matches, way)[10:]) > 0.95


def test_both_ways_are_believed_until_the_pictures_tell() -> None:
    matcher, metric = matcher_on(FORK), identity_metric(views())
    for frame in compared(metric, [*views()[5:30]]):
        matcher.update(frame)
    for _ in range(3):
        candidate = matcher.update(None)
    belief = posterior_of(candidate, COUNT)
    np.testing.assert_allclose(belief[60:63], belief[30:33], rtol=0.05)
    assert belief[60:63].sum() > 0.4
    assert belief[55:60].max() < 0.01


def test_where_no_link_leads_a_route_is_no_way_to_the_next_one() -> None:
    matcher, metric = matcher_on(network(COUNT, [0, 60])), identity_metric(views())
    for frame in compared(metric, [*views()[40:60]]):
        matcher.update(frame)
    for _ in range(3):
        candidate = matcher.update(None)
    assert posterior_of(candidate, COUNT)[60:].max() < 0.01


def test_a_map_with_another_graph_is_followed_along_it(small_map: Map) -> None:
    count = small_map.places.count
    circuit = with_graph(small_map, network(count, links=[(count - 1, 0)]).graph)
    assert circuit.topology.graph is circuit.graph
    (metric, *_), (before, *_) = circuit.metrics, small_map.metrics
    np.testing.assert_array_equal(metric.steps[0, 1:], before.steps[0, 1:])
    assert metric.steps[0, 0] != before.steps[0, 0]
    for rule in ("filter", "evidence"):  # of one route, which windows may follow
        Recognizer(circuit, Config.model_validate({"matching": {"rule": rule}}))


def test_windows_are_not_compared_across_routes() -> None:
    channel, topology = channel_without_segments(identity_metric(views())), network(COUNT, [0, 60])
    with pytest.raises(ConfigError, match="rule evidence: does not follow several routes"):
        ChannelStage({0: channel}, MatchingConfig(rule="evidence"), topology=topology)
