"""``placefield listen``: matches as they come."""

import json
import logging
from typing import Annotated

import typer

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.fusion.match import FASTER
from placefield_tools.cli import options
from placefield_tools.record.records import as_object

log = logging.getLogger(__name__)


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("listen")(_listen)


def _listen(
    as_json: Annotated[bool, typer.Option("--json", help="print JSON lines")] = False,
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Print the matches of a run as they come, a line each, until Ctrl-C.

    A frame has its match at once, and a smoothed one, which knows frames after it, later.

    Examples:
      placefield listen
      placefield listen --run rear --json
    """
    from placefield.bus.keys import Keys
    from placefield.bus.refusing import count_refused
    from placefield.bus.session import open_bus
    from placefield.errors import MessageError
    from placefield_services.process import stop_event
    from placefield_tools.common.natural_sort import counted
    from placefield_tools.listen.match_queue import MatchQueue, warn_of_other_runs

    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, bus__credentials=credentials
    )
    keys = Keys(effective.run)
    stop = stop_event()
    with open_bus(effective.bus, stop, viewer=True) as bus:
        matches = MatchQueue(bus, keys, smoothed=True)
        warn_of_other_runs(bus, effective.run)
        while not stop.is_set():
            try:
                taken = matches.get(0.1)
            except MessageError as error:
                count_refused(matches.counts, error)
                bus.log_dropped("match", error)
                continue
            if taken is not None:
                print((_as_json if as_json else _as_line)(*taken), flush=True)
    if others := matches.counts["other_map"]:
        log.warning("%s of another map refused", counted(others, "message"))


def _as_line(header: Header, match: MatchMessage | None) -> str:
    if match is None:
        return f"end of stream {header.stream[:8]}: {header.sequence} frames"
    place = "no place" if match.place < 0 else f"place {match.place}"
    smoothed = isinstance(match, SmoothedMessage)
    frame = f"{'  smoothed ' if smoothed else ''}frame {header.sequence}"
    parts = [f"{frame}: {place}, score {match.score:.2f}"]
    if match.probability is not None:
        known = "known" if match.known else "unknown"
        verdict = FASTER if match.too_fast else known
        parts.append(f"{verdict}, right with probability {match.probability:.3f}")
    if match.pose is not None:
        x, y, yaw = match.pose
        parts.append(f"at x {x:.2f} m, y {y:.2f} m, yaw {yaw:.2f} rad")
    if match.missing:
        parts.append(f"without channels {', '.join(map(str, match.missing))}")
    if match.forgotten:
        parts.append("the stream's memory was lost")
    if isinstance(match, SmoothedMessage):
        parts.append(f"{match.lag} frames later")
    return ", ".join(parts)


def _as_json(header: Header, match: MatchMessage | None) -> str:
    return json.dumps(as_object(header, match))
