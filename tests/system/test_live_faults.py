"""A camera's stream whose featurizer is killed: it loses what comes meanwhile, and counts it."""

import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle, pairwise
from pathlib import Path

from hosting import Host, Listener, wait_until

from placefield.bus.connecting import open_bus
from placefield.config import BusConfig, Config
from placefield.features.frames import Frame
from placefield_tools.replay.replay_source import replay
from placefield_tools.sources import Source, open_source

RATE = 30.0
"""Frames a second."""

AWAY = 15
"""Frames that are lost at least: a service that died is started again after half a second."""

BEFORE, AFTER = 60, 30
"""Frames that are answered before the fault, and after it."""


class Camera(Source):
    """Gives the frames of a folder, over and over, and does not wait for answers."""

    live = True
    count = None

    def __init__(self, folder: Path) -> None:
        self._frames = list(open_source(str(folder)))

    def __iter__(self) -> Iterator[Frame]:
        return cycle(self._frames)


def test_a_live_stream_loses_what_comes_while_its_featurizer_is_away_and_counts_it(
    logs: Path, map_path: Path, query_dir: Path
) -> None:
    enough = threading.Event()
    with Host(logs, map_path, "--workers", "1") as host, host.listener() as listener:
        bus_config = BusConfig(endpoint=host.endpoint)
        with open_bus(bus_config) as bus, ThreadPoolExecutor() as aside:
            streaming = Camera(query_dir), bus, Config(bus=bus_config), enough
            replayed = aside.submit(replay, *streaming, rate=RATE)
            try:
                answered = [taken_sequence(listener) for _ in range(BEFORE)]
                (featurizer,) = host.service("featurizer")
                featurizer.send_signal(signal.SIGKILL)
                while answered[-1] - answered[-2] < AWAY:
                    answered.append(taken_sequence(listener))
                answered += [taken_sequence(listener) for _ in range(AFTER)]
            finally:
                enough.set()
            while (received := listener.next_match())[1] is not None:
                answered.append(received[0].sequence)
            sent = replayed.result().sent
        assert all(before < after for before, after in pairwise(answered))
        lost = sent - len(answered)
        assert lost >= AWAY
        # A worker that is short of time drops more; such frames are answered, and flagged.
        wait_until(lambda: listener.count("channel", "gaps") >= lost, "what was lost is counted")


def taken_sequence(listener: Listener) -> int:
    header, match = listener.next_match()
    assert match is not None
    return header.sequence
