"""A day's frames through the services: what memory they take, and whether answers stay the same."""

import math
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys
from placefield.bus.messages import MatchMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config, FeatureConfig, ScaleConfig
from placefield.errors import BusError
from placefield.features.frames import Frame
from placefield.maps.manifest import SUFFIX
from placefield.maps.store import save_map
from placefield_tools.bench.figure import Figure
from placefield_tools.bench.host_chain import Chain, started
from placefield_tools.bench.street_frames import street_frames, write_frames
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.listen.match_queue import MatchQueue
from placefield_tools.replay.replay_source import replay
from placefield_tools.sources import Source

HOURS = 24
PLACES = 120
_SIZE = (160, 120)
_LAST_MATCH_S = 30.0


class _Laps(Source):
    """The same frames over and over, so many in all."""

    count: int

    def __init__(self, frames: list[bytes], count: int) -> None:
        self._frames, self.count = frames, count

    def __iter__(self) -> Iterator[Frame]:
        for index in range(self.count):
            image = self._frames[index % len(self._frames)]
            yield Frame(index=index, stamp_ns=index, name=f"frame {index}", image=image)


def bench_soak(*, frames: int) -> list[Figure]:
    """Stream laps of a short route through a host, all in one stream, as fast as it goes.

    Small frames in grayscale and two channels: it is about what piles up, not about the work.
    Before and after, one lap by itself is to have the same matches to the last bit.

    Args:
        frames: how many at least; every hour is of whole laps.

    Raises:
        BusError: the services do not answer.
    """
    laps = math.ceil(frames / (HOURS * PLACES))
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        map_path = _build(Path(folder))
        query = street_frames(PLACES, size=_SIZE, shift=8)
        up = [*PLACEFIELD, "up", str(map_path), "--workers", "1"]
        with started([up]) as [host]:
            return _Soak(host, query, laps).figures()


def _build(folder: Path) -> Path:
    reference, map_path = folder / "reference", folder / f"street{SUFFIX}"
    write_frames(reference, street_frames(PLACES, size=_SIZE))
    config = Config(features=FeatureConfig(kind="grayscale"), scales=ScaleConfig(channels=2))
    save_map(build_from([str(reference)], config), map_path)
    return map_path


class _Soak:
    """A host, and a stream of 24 hours, of so many laps each."""

    def __init__(self, host: Chain, query: list[bytes], laps: int) -> None:
        self._host, self._query, self._hour = host, query, laps * len(query)
        self._config = Config(bus=BusConfig(endpoint=host.endpoint))

    def figures(self) -> list[Figure]:
        fresh = self._matches_of(1)
        sizes, others, partial = self._day()
        afresh = self._matches_of(1)
        same = sum(one == other for one, other in zip(fresh, afresh, strict=True)) / len(fresh)
        if sizes[-1].keys() != sizes[0].keys():
            raise BusError("a process ended on the way and was started again; see above")
        growth = max(sizes[-1][pid] / size for pid, size in sizes[0].items()) - 1
        return [
            Figure("soak_frames", self._hour * HOURS, "in one stream, each of them answered"),
            Figure("soak_growth", growth, "memory of what grew most since hour 1", at_most=0.05),
            Figure("soak_mib", sum(sizes[-1].values()) / 2**20, "memory of all processes at last"),
            Figure("soak_other", others, "frames matched unlike in hour 1", at_most=0),
            Figure("soak_partial", partial, "frames not answered by all channels", at_most=0),
            Figure("soak_afresh", same, "share of a lap equal before and after", at_least=1),
        ]

    def _matches_of(self, laps: int) -> list[MatchMessage]:
        return list(self._stream(laps * len(self._query)))

    def _stream(self, frames: int) -> Iterator[MatchMessage]:
        """Yield the matches of a stream as they come; the stream waits for the reader."""
        stop = threading.Event()
        with open_bus(self._config.bus) as bus, ThreadPoolExecutor(1) as aside:
            matches = MatchQueue(bus, Keys(self._config.run))
            replayed = aside.submit(self._replay, bus, frames, stop)
            try:
                for _ in range(frames):
                    yield _next_of(matches)
            except BusError:
                stop.set()
                replayed.result()  # what it raises says more
                raise
            replayed.result()

    def _replay(self, bus: Bus, frames: int, stop: threading.Event) -> None:
        replay(_Laps(self._query, frames), bus, self._config, stop)

    def _day(self) -> tuple[list[dict[int, int]], int, int]:
        """Return the memory of each process hour by hour, and how many matches are not right."""
        sizes: list[dict[int, int]] = []
        expected: dict[int, tuple[int, bool | None]] = {}
        others = partial = 0
        lap = len(self._query)  # to find in, before the first hour
        for number, match in enumerate(self._stream(lap + self._hour * HOURS), start=-lap):
            hour, turn = number // self._hour, number % lap
            if hour <= 0:
                expected[turn] = match.place, match.known
            elif (match.place, match.known) != expected[turn]:
                others += 1
            partial += bool(match.missing)
            if number >= 0 and (number + 1) % self._hour == 0:
                sizes.append(self._host.resident_by_process())
        return sizes, others, partial


def _next_of(matches: MatchQueue) -> MatchMessage:
    received = matches.get(_LAST_MATCH_S)
    if received is None or received[1] is None:
        raise BusError(f"no match for {_LAST_MATCH_S:g} s; see above")
    return received[1]
