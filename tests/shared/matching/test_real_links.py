"""The links of real routes: a circuit of an office, and forks made of a walk; docs/method.md."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from route_networks import network

from placefield.config import MatchingConfig
from placefield.features.descriptors import DescriptorStream
from placefield.features.extract import feature_of
from placefield.features.fitting import fit_descriptors
from placefield.fusion.fused_stream import FusedStream
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match
from placefield.maps.alignment import channel_without_segments
from placefield.maps.map_metrics import identity_metric, steps_along
from placefield.maps.topology import Topology
from placefield.matching.channel_stage import ChannelStage

pytestmark = pytest.mark.slow

Raws = NDArray[np.float32]
LAP = 40  # frames
TOLERANCE = 3


@pytest.fixture(scope="module")
def raws_of(data_dir: Path) -> Callable[[str], Raws]:
    describe = feature_of("gist").describe

    def raws(drive: str) -> Raws:
        images = sorted(
            (data_dir / drive).iterdir(), key=lambda path: int(path.stem.split("_")[-1])
        )
        return np.stack([describe(image.read_bytes()) for image in images])

    return raws


def matches_of(reference: Raws, query: Raws, topology: Topology) -> tuple[list[Match], list[Match]]:
    """Causal and smoothed matches, on a map of one channel without a learned metric."""
    model, (descriptors,) = fit_descriptors([reference], "gist", dimensions=300, standardise=True)
    metric = identity_metric(descriptors)
    steps = steps_along(metric.places, metric.unit, topology.graph)
    channel = channel_without_segments(replace(metric, steps=steps))
    config, described = MatchingConfig(tolerance=TOLERANCE), DescriptorStream(model)
    stage = ChannelStage({0: channel}, config, topology=topology)
    stream = FusedStream(stage, FusionStage(topology, config), [config.lag])
    observed = [described.update(raw) for raw in query]
    causal = [
        stream.update(None if one is None else next(stage.compare([one]))) for one in observed
    ]
    stream.finish()
    return causal, [each.match for each in stream.smoothed()]


def frames_until_known(matches: Sequence[Match], right: Sequence[set[int]], since: int) -> int:
    """Return after how many frames the first match is known and right."""
    pairs = zip(matches[since:], right[since:], strict=True)
    return next(
        (
            number
            for number, (match, there) in enumerate(pairs)
            if match.known and match.place in there
        ),
        len(matches) - since,
    )


@pytest.mark.parametrize("seam", [0, 10, 20, 30])
def test_at_the_seam_of_a_circuit_the_next_lap_is_known_at_once(
    raws_of: Callable[[str], Raws], data_dir: Path, seam: int
) -> None:
    raws = raws_of("office/drive")
    rows = [
        [*map(int, row.split(","))]
        for row in (data_dir / "office" / "loops.csv").read_text().splitlines()[1:]
    ]
    right: list[set[int]] = [set() for _ in raws[LAP:]]
    for frame, first, last in rows:
        right[frame - LAP] |= {(place - seam) % LAP for place in range(first, last + 1)}
    lap = [(seam + place) % LAP for place in range(LAP)]
    circuit = network(LAP, links=[(LAP - 1, 0)])
    passed = seam or LAP  # frames of the second lap
    linked, alone = (
        [frames_until_known(each, right, passed) for each in matches_of(raws[lap], raws[LAP:], of)]
        for of in (circuit, network(LAP))
    )
    print(f"seam at {seam}: causal, smoothed: {alone} frames; with the link: {linked}")
    assert linked <= [1, 0]
    assert alone >= [4, 2]


@pytest.mark.parametrize("fork", [40, 64, 94])
def test_after_a_fork_either_way_is_known_at_once(
    raws_of: Callable[[str], Raws], fork: int
) -> None:
    """The second way shows another part of the walk, which no vehicle observed before the fork."""
    left, right_side = raws_of("gardens_point/day_left"), raws_of("gardens_point/day_right")
    second = fork + LAP
    elsewhere = [*range(120 + fork % LAP, 199)]
    reference = np.concatenate([left[:second], left[elsewhere]])
    ways = {
        fork + 1: [*range(fork + 1, second)],
        second: elsewhere[:30],
    }
    for begin, frames in ways.items():
        query = right_side[[*range(fork - 25, fork + 1), *frames]]
        places = [*range(fork - 25, fork + 1), *range(begin, begin + len(frames))]
        right = [{*range(place - TOLERANCE, place + TOLERANCE + 1)} for place in places]
        for links in ([], [(fork, second)]):
            topology = network(len(reference), [0, second], links)
            matches = matches_of(reference, query, topology)
            causal, smoothed = (frames_until_known(each, right, 26) for each in matches)
            print(f"fork at {fork} to {begin}, links {links}: {causal}, smoothed {smoothed} frames")
            assert not links or (causal <= 6 and smoothed == 0)
