"""Frames through the services, beside the same processes doing no work."""

import statistics
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys, part_of, service_and_identity
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config
from placefield.maps.manifest import SUFFIX
from placefield.maps.store import save_map
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.host_chain import Chain, started
from placefield_tools.bench.idle_chain import Shape
from placefield_tools.bench.load import Answers, LiveCamera, play
from placefield_tools.bench.many_cameras import camera_figures
from placefield_tools.bench.ratio import Ratio
from placefield_tools.bench.street_frames import street_frames, write_frames
from placefield_tools.bench.timing import repeat
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.replay.replay_source import replay
from placefield_tools.sources import open_source

PLACES = 1261
_REPLAYED = 640  # frames, each time
_REPLAYS = 3
_RATE = 30.0  # frames per second
_SECONDS = 5.0
_LIMIT_S = 120.0
_WARM_UP_S = 2.0

_KEYS = Keys(Config().run)


def bench_chain() -> list[Figure]:
    """Measure one stream through real processes on a bus of their own, and many cameras.

    JPEGs of 640 x 480 against a map of 1261 places, GIST, 4 channels.
    """
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        map_path = Path(folder) / f"street{SUFFIX}"
        _build(Path(folder) / "reference", map_path)
        query = write_frames(Path(folder) / "query", street_frames(_REPLAYED, shift=8))
        return [*_stream_figures(map_path, query), *camera_figures(map_path)]


def _build(reference: Path, map_path: Path) -> None:
    write_frames(reference, street_frames(PLACES))
    save_map(build_from([str(reference)], Config()), map_path)


def _stream_figures(map_path: Path, query: Path) -> list[Figure]:
    frames = [frame.read_bytes() for frame in sorted(query.iterdir())]
    up = [*PLACEFIELD, "up", str(map_path)]
    with started([up]) as [real], _bus(real) as bus:
        shape = shape_of(bus, frames)
        with started([shape.command()]) as [idle], _bus(idle) as idle_bus:
            chains = [(real, bus), (idle, idle_bus)]
            rates = [[_frames_per_s(*chain, query) for chain in chains] for _ in range(_REPLAYS)]
            cameras = [LiveCamera(of, _KEYS.run) for _, of in chains]
            for camera in cameras:
                play([camera], frames, rate=_RATE, seconds=_WARM_UP_S)
            answers: list[list[Answers]] = []

            def in_turn() -> list[float]:
                answers.append(
                    [play([camera], frames, rate=_RATE, seconds=_SECONDS) for camera in cameras]
                )
                return _latencies(answers[-1])

            repeat(in_turn, [(0, 1), (2, 3)], limit_s=_LIMIT_S)
    return [*rate_figures(rates), *latency_figures(answers)]


@contextmanager
def _bus(chain: Chain) -> Iterator[Bus]:
    with open_bus(BusConfig(endpoint=chain.endpoint)) as bus:
        yield bus


def shape_of(bus: Bus, frames: Sequence[bytes]) -> Shape:
    """Measure the real chain: the channels of each worker and the size of the messages."""
    features, candidates = _Sizes(bus, _KEYS.feature), _Sizes(bus, _KEYS.all_candidates)
    play([LiveCamera(bus, _KEYS.run)], frames, rate=_RATE, seconds=_WARM_UP_S)
    workers: defaultdict[str, list[int]] = defaultdict(list)
    for token in sorted(bus.alive(_KEYS.all_alive("channel"))):
        _, identity = service_and_identity(token)
        part = part_of(identity)
        if part is not None:
            workers[identity.partition("-")[2]].append(part.channel)
    return Shape(tuple(map(tuple, workers.values())), features.median, candidates.median)


class _Sizes:
    """How large the messages are that come on a key, bytes."""

    def __init__(self, bus: Bus, key: str) -> None:
        self._seen: list[int] = []
        bus.subscribe_raw(key, self._see)

    def _see(self, key: str, payload: bytes) -> None:
        if payload:  # the end of a stream has none
            self._seen.append(len(payload))

    @property
    def median(self) -> int:
        return statistics.median_high(self._seen)


def _frames_per_s(chain: Chain, bus: Bus, query: Path) -> float:
    config = Config(bus=BusConfig(endpoint=chain.endpoint))
    with open_source(str(query)) as source:
        start = time.perf_counter()
        sent = replay(source, bus, config, threading.Event()).sent
        return sent / (time.perf_counter() - start)


def rate_figures(rates: Sequence[Sequence[float]]) -> list[Figure]:
    """Make figures of the frames per second of each replay, real and idle."""
    real, idle = np.median(rates, axis=0)
    return [
        Figure("chain_frames_per_s", real, "lossless, JPEG 640 x 480 to match", at_least=150),
        Figure("chain_idle_frames_per_s", idle, "the same through the chain that does no work"),
    ]


def latency_figures(answers: Sequence[Sequence[Answers]]) -> list[Figure]:
    """Make figures of the answers of each round, real and idle; ratios are of the same round."""
    rounds = np.array([_latencies(turn) for turn in answers])
    real, idle, real_95, idle_95 = np.median(rounds, axis=0) * 1e3
    ratio = Ratio.of(rounds[:, 0], rounds[:, 1])
    ratio_95 = Ratio.of(rounds[:, 2], rounds[:, 3])
    lost = sum(real.lost for real, _ in answers)
    return [
        Figure("chain_latency_ms", real, "median from frame to match, live at 30 frames/s"),
        Figure("chain_latency_95_ms", real_95, "95th percentile of it"),
        Figure("chain_idle_latency_ms", idle, "median, the chain that does no work"),
        Figure("chain_idle_latency_95_ms", idle_95, "95th percentile of it"),
        Figure("chain_latency_ratio", ratio, "median latency over the idle chain's", at_most=2.2),
        Figure("chain_latency_95_ratio", ratio_95, "95th percentiles likewise"),
        Figure("chain_lost_frames", lost, "dropped or not answered by all channels", at_most=0),
    ]


def _latencies(turn: Sequence[Answers]) -> list[float]:
    """Return the medians, real and idle, then the 95th percentiles, real and idle, seconds."""
    return [float(np.quantile(each.latencies, share)) for share in (0.5, 0.95) for each in turn]
