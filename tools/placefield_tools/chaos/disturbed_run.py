"""Replays frames through its own services, with faults from a schedule."""

import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config
from placefield.errors import BusError, MessageError
from placefield.maps.opening import open_map
from placefield.recognizer import Recognizer
from placefield_tools.chaos.children import Children
from placefield_tools.chaos.clock import Clock
from placefield_tools.chaos.fault_injector import FaultInjector
from placefield_tools.chaos.faulty_source import FaultySource, looped
from placefield_tools.chaos.schedule import Fault
from placefield_tools.chaos.verdict import Answered, Verdict, judge
from placefield_tools.common.host_process import free_endpoint
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.listen.match_queue import MatchQueue
from placefield_tools.replay.replay_source import replay
from placefield_tools.sources import Source

_START_S = 60.0
_LAST_MATCH_S = 5.0
_POLL_S = 0.1


def disturbed_replay(
    map_path: Path,
    source: Source,
    faults: Sequence[Fault],
    config: Config,
    clock: Clock,
    *,
    channels: Sequence[Sequence[int]],
    frames: int,
    rate: float,
) -> Verdict:
    """Replay frames through services while faults are injected, and judge the answers.

    Args:
        map_path: map of the services.
        source: frames to replay, not a live source; it repeats from its start.
        faults: faults in ascending order of frames.
        config: configuration of the services, which use a port of their own.
        clock: clock that times faults and answers.
        channels: channels of each channel worker.
        frames: number of frames to replay.
        rate: frames per second, at most.

    Raises:
        BusError: the services do not start.
    """
    placemap = open_map(map_path)
    recognizer = Recognizer(placemap, config)
    undisturbed = [recognizer.update_frame(frame) for frame in looped(source, frames)]
    bus_config = BusConfig(endpoint=free_endpoint(), connect_timeout_s=_START_S)
    config = config.model_copy(update={"bus": bus_config})
    with (
        _services(map_path, placemap.lineage, channels, config, clock) as children,
        open_bus(config.bus) as bus,
    ):
        _await_ready(bus, Keys(config.run), channels, clock)
        injector = FaultInjector(children, bus, Keys(config.run))
        faulty = FaultySource(source, frames, faults, injector.begin, injector.end, clock)
        with open_bus(config.bus) as apart, _listening(apart, config, clock) as answers:
            sent = replay(faulty, bus, config, threading.Event(), rate=rate).sent
    return judge(undisturbed, answers, faulty.happened, sent)


@contextmanager
def _listening(bus: Bus, config: Config, clock: Clock) -> Iterator[dict[int, Answered]]:
    """Collect the answers by frame; the end of the block waits for the last ones."""
    answers: dict[int, Answered] = {}
    matches = MatchQueue(bus, Keys(config.run))
    patience = threading.Event()  # set: stop if no match comes for a while

    def gather() -> None:
        left = _LAST_MATCH_S
        while left > 0:
            answer = None
            with suppress(MessageError):
                answer = matches.get(_POLL_S)
            if answer is None:
                left -= _POLL_S * patience.is_set()
                continue
            header, match = answer
            if match is None:
                return
            answers[header.sequence] = Answered(match.match, clock.monotonic())

    gatherer = threading.Thread(target=gather, daemon=True)
    gatherer.start()
    try:
        yield answers
    finally:
        patience.set()
        gatherer.join()


@contextmanager
def _services(
    map_path: Path,
    lineage: str,
    channels: Sequence[Sequence[int]],
    config: Config,
    clock: Clock,
) -> Iterator[Children]:
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        file = Path(folder) / "config.toml"
        file.write_text(config.to_toml())
        with Children(_commands(map_path, lineage, channels, file), clock) as children:
            yield children


def _commands(
    map_path: Path, lineage: str, channels: Sequence[Sequence[int]], config: Path
) -> Mapping[str, Sequence[str]]:
    the_map = (map_path, "--lineage", lineage)

    def command(service: str, *own: object) -> list[str]:
        flags = [*map(str, own), "--config", str(config)]
        return [*PLACEFIELD, service, *flags]

    workers = {
        f"channel {number}": command("channel", *the_map, *(f"--channel={each}" for each in own))
        for number, own in enumerate(channels)
    }
    return {
        "router": command("router"),
        "featurizer": command("featurizer", *the_map),
        "fuser": command("fuser", *the_map),
    } | workers


def _await_ready(bus: Bus, keys: Keys, channels: Sequence[Sequence[int]], clock: Clock) -> None:
    needed = {"featurizer": 1, "fuser": 1, "channel": sum(map(len, channels))}
    end = clock.monotonic() + _START_S
    while any(len(bus.alive(keys.all_alive(name))) < count for name, count in needed.items()):
        if clock.monotonic() > end:
            raise BusError(f"the services did not start within {_START_S:g} s")
        clock.sleep(_POLL_S)
