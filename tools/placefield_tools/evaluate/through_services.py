"""Matching a query through the services: real processes on a separate bus."""

import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from placefield.bus.connecting import open_bus
from placefield.bus.keys import Keys
from placefield.bus.messages import SmoothedMessage
from placefield.config import BusConfig, Config
from placefield.errors import BusError
from placefield.fusion.match import Match, SmoothedMatch
from placefield_tools.common.host_process import await_ready, free_endpoint
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.listen.match_queue import MatchQueue, stream_matches
from placefield_tools.replay.replay_source import replay
from placefield_tools.sources import Source

_START_S = 60.0
_LAST_MATCH_S = 5.0


def match_through_services(
    map_path: Path, source: Source, config: Config
) -> tuple[list[Match], list[SmoothedMatch]]:
    """Start a whole host, replay a source through it, and return its matches in order.

    Returns:
        The causal and the smoothed match of every frame.

    Raises:
        BusError: the services do not start or stop answering.
    """
    bus = BusConfig(endpoint=free_endpoint(), connect_timeout_s=config.bus.connect_timeout_s)
    alone = config.model_copy(update={"bus": bus})
    with _host(map_path, alone), open_bus(bus) as session:
        matches = MatchQueue(session, Keys(alone.run), smoothed=True)
        sent = replay(source, session, alone, threading.Event()).sent
        answered, smoothed = [], []
        for header, message in stream_matches(matches, _LAST_MATCH_S):
            if isinstance(message, SmoothedMessage):
                smoothed.append(SmoothedMatch(header.sequence, message.match, message.lag))
            else:
                answered.append(message.match)
    if len(answered) != sent or len(smoothed) != sent:
        raise BusError(
            f"{sent} frames were sent through the services, {len(answered)} matched and "
            f"{len(smoothed)} smoothed"
        )
    return answered, smoothed


@contextmanager
def _host(map_path: Path, config: Config) -> Iterator[None]:
    """Run ``placefield up``; it is ready inside the block, and stopped after it."""
    command = [*PLACEFIELD, "up", str(map_path)]
    command += ["--endpoint", config.bus.endpoint, "--run", config.run]
    command += ["--rule", config.matching.rule]
    command += ["--set", f"matching.tolerance={config.matching.tolerance}"]
    command += ["--precision", str(config.matching.precision)]
    command += ["--set", f"matching.lag={config.matching.lag}"]
    command += ["--set", f"matching.neighbourhood={config.matching.neighbourhood}"]
    command += ["--set", f"matching.reverse={str(config.matching.reverse).lower()}"]
    command += ["--set", f"matching.exact={str(config.matching.exact).lower()}"]
    command += ["--set", f"fusion.deadline_s={config.fusion.deadline_s}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            await_ready(process, _START_S)
            yield
        finally:
            process.terminate()
