"""Matching at the size of the paper, beside its equations and beside bare distances."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from typing import get_args

import faiss  # type: ignore[import-not-found,import-untyped,unused-ignore]
import numpy as np
from numpy.typing import NDArray

from placefield.config import MatchingConfig, Rule
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match
from placefield.maps.map import MapChannel
from placefield.maps.map_metrics import identity_metric
from placefield.maps.topology import Topology
from placefield.matching.channel_stage import ChannelStage
from placefield_tools.bench.evaluate_speed import evaluation_figures
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.random_walks import observed_again, random_walk
from placefield_tools.bench.reference_implementation import literal_match
from placefield_tools.bench.synthetic import CHANNELS, SCALES, made_channel
from placefield_tools.bench.timing import Timings

PLACES, DIMENSIONS = 1261, 500
BATCH = 64
"""Frames of a micro-batch."""

_OURS = 3  # the number of the first way that is ours

Array = NDArray[np.float32]
OfFrames = Callable[[Array], object]


def bench_match() -> list[Figure]:
    """Measure matching on one core: every rule, the route driven both ways, by frame and batch.

    Each channel has a metric of its own, as if all had been learned; once more they share one, as
    they do where none was.
    """
    places = random_walk(PLACES, DIMENSIONS, seed=0)
    query = observed_again(places[200 : 200 + BATCH], 0.5, seed=1)
    channels = [made_channel(places, number) for number in range(CHANNELS)]
    bare, peer = _bare_distances(places), _faiss_search(places)
    variants = {
        f"{rule}{'_reverse' * reverse}": _matching(channels, rule, reverse)
        for rule, reverse in product(get_args(Rule), (False, True))
    }
    ways: list[Callable[[], object]] = [
        _one_by_one(bare, query),
        partial(bare, query),
        _one_by_one(peer, query),
    ]
    unlearned = identity_metric(places)
    variants["filter_shared_metric"] = _matching(
        [replace(channel, metric=unlearned) for channel in channels], "filter", False
    )
    for match in variants.values():
        ways += [_one_by_one(match, query), partial(match, query)]
    of_variants = range(_OURS, len(ways), 2)
    compared = [pair for way in of_variants for pair in _pairs(way)]
    times = Timings.of(ways, compared=[(0, 1), *compared])
    figures = _distance_figures(times)
    for name, way in zip(variants, of_variants, strict=True):
        figures += _match_figures(name, times, way)
    literal = _literal_figure(channels, places, _one_by_one(variants["ams"], query))
    return [literal, *figures, *evaluation_figures()]


def _matching(channels: list[MapChannel], rule: Rule, reverse: bool) -> OfFrames:
    """Return what matches the next descriptors (B, N) of a stream."""
    config = MatchingConfig(rule=rule, reverse=reverse)
    stage = ChannelStage(dict(enumerate(channels)), config)
    stream, fusion = stage.new_stream(), FusionStage(Topology.line(PLACES), config)

    def match(descriptors: Array) -> list[Match]:
        compared = stage.compare(list(descriptors))
        return [fusion.fuse(stream.update(of_frame)) for of_frame in compared]

    return match


def _bare_distances(places: Array) -> OfFrames:
    """Return what multiplies descriptors with the places of every channel, and nothing else."""
    of_channels = [places + np.float32(number) for number in range(CHANNELS)]

    def multiply(descriptors: Array) -> None:
        for of_channel in of_channels:
            if len(descriptors) == 1:
                of_channel @ descriptors[0]
            else:
                descriptors @ of_channel.T

    return multiply


def _faiss_search(places: Array) -> OfFrames:
    faiss.omp_set_num_threads(1)
    indexes = []
    for number in range(CHANNELS):
        indexes.append(faiss.IndexFlatL2(DIMENSIONS))
        indexes[-1].add(places + np.float32(number))
    return lambda descriptors: [index.search(descriptors, 1) for index in indexes]


def _one_by_one(of_frames: OfFrames, query: Array) -> Callable[[], object]:
    return lambda: [of_frames(frame[None]) for frame in query]


def _distance_figures(times: Timings) -> list[Figure]:
    bytes_read = 4 * CHANNELS * PLACES * DIMENSIONS * BATCH
    return [
        Figure("distances_us", 1e6 * times.median(0) / BATCH, "bare distances, a frame"),
        Figure("distances_gb_per_s", 1e-9 * bytes_read / times.median(0), "they read"),
        Figure("distances_batch_speedup", times.ratio(0, 1), f"them in batches of {BATCH}"),
    ]


def _pairs(way: int) -> list[tuple[int, int]]:
    """The ratios of one rule, see ``_match_figures``."""
    return [(way, 0), (2, way), (way + 1, 1), (way, way + 1)]


def _match_figures(name: str, times: Timings, way: int) -> list[Figure]:
    """The figures of one rule: ``way`` is by frame, the next one in batches."""
    rate = BATCH / times.median(way)
    over, peer, batch_over, batch = (times.ratio(*pair) for pair in _pairs(way))
    return [
        Figure(f"{name}_frames_per_s", rate, f"{name}, one core", at_least=1000),
        Figure(f"{name}_over_distances", over, "over bare distances", at_most=1.5),
        Figure(f"{name}_faiss_over_match", peer, "IndexFlatL2 over it", at_least=1),
        Figure(
            f"{name}_batch_over_distances",
            batch_over,
            "in batches, over bare distances in batches",
            at_most=1.5,
        ),
        Figure(f"{name}_batch_speedup", batch, "by frame over batches", at_least=3),
    ]


def _literal_figure(
    channels: list[MapChannel], places: Array, ours: Callable[[], object]
) -> Figure:
    """Compare one match of the equations with ``ours``, which makes a batch of them."""
    projections = [(channel.metric.projection, places) for channel in channels]
    literal = partial(literal_match, places[: SCALES[-1]], projections, SCALES)
    ratio = Timings.of([literal, ours], compared=[(0, 1)]).ratio(0, 1)
    what = "the equations, to the letter, over ams"
    return Figure("literal_over_match", ratio.times(BATCH), what, at_least=100)
