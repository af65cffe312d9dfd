"""The chain that does no work, in real processes."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from placefield.bus.connecting import open_bus
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config
from placefield_tools.bench.chain import shape_of
from placefield_tools.bench.host_chain import started
from placefield_tools.bench.idle_chain import Shape
from placefield_tools.bench.load import LiveCamera, play
from placefield_tools.replay.replay_source import replay
from placefield_tools.sources import open_source

SHAPE = Shape(workers=((0, 2), (1,)), feature=1300, candidates=70)


@pytest.fixture(scope="module")
def config() -> Iterator[Config]:
    """Where an idle chain runs."""
    with started([SHAPE.command()]) as [chain]:
        yield Config(bus=BusConfig(endpoint=chain.endpoint))


@pytest.fixture
def bus(config: Config) -> Iterator[Bus]:
    with open_bus(config.bus) as opened:
        yield opened


def test_it_answers_every_frame_of_a_lossless_stream(
    bus: Bus, config: Config, query_dir: Path
) -> None:
    with open_source(str(query_dir)) as source:
        assert replay(source, bus, config, threading.Event()).sent == source.count


def test_it_answers_every_frame_of_a_live_stream(bus: Bus, config: Config) -> None:
    answers = play([LiveCamera(bus, config.run)], [b"no image"], rate=20, seconds=1)
    assert (answers.sent, answers.lost) == (20, 0)


def test_its_shape_is_read_off_a_chain_that_runs(bus: Bus) -> None:
    seen = shape_of(bus, [b"no image"])
    assert {*seen.workers} == {*SHAPE.workers}
    assert (seen.feature, seen.candidates) == (SHAPE.feature, SHAPE.candidates)
