"""``placefield listen``: matches as they come."""

import json
import logging
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.bus.verified_messages import WORDS, RelativePoseMessage, VerifiedMessage
from placefield_tools.cli import options, options_map
from placefield_tools.common.certainty import certainty_of, percent
from placefield_tools.common.place_words import place_words
from placefield_tools.record.records import as_object, kind_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from placefield.maps.route_graph import RouteGraph

log = logging.getLogger(__name__)


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("listen")(_listen)


def _listen(
    as_json: Annotated[bool, typer.Option("--json", help="print JSON lines")] = False,
    map_path: Annotated[
        Path | None,
        typer.Option("--map", metavar="MAP", help="name the routes of this map of several routes"),
    ] = None,
    run: options.Run = None,
    precision: options_map.Precision = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Print the matches of a run as they come, a line each, until Ctrl-C.

    Each frame has a match at once, and a smoothed match later, which uses the frames after it. If
    there are verifiers, it also has a verified match.
    A match is known, or likely, or unknown. Give --precision as the services have it, for the
    percentage asked. A map of several routes numbers its places from the first one; with --map, a
    match says its route and the place in it.

    Examples:
      placefield listen
      placefield listen --run rear --json
      placefield listen --map town.pfmap
    """
    from placefield.bus.connecting import open_bus
    from placefield.bus.keys import Keys
    from placefield.bus.refusing import count_refused
    from placefield.errors import MessageError
    from placefield.maps.opening import open_map
    from placefield_services.process import stop_event
    from placefield_tools.common.natural_sort import counted
    from placefield_tools.listen.match_queue import MatchQueue, warn_of_other_runs

    effective = options.effective_config(
        config,
        settings,
        runs=run,
        matching__precision=precision,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
    )
    graphs = {}
    if map_path is not None:
        placemap = open_map(map_path, channels=())
        graphs[placemap.digest] = placemap.graph
    as_line = partial(_as_line, precision=effective.matching.precision, graphs=graphs)
    printed = _as_json if as_json else as_line
    keys = Keys(effective.run)
    stop = stop_event()
    with open_bus(effective.bus, stop, viewer=True) as bus:
        matches = MatchQueue(bus, keys, smoothed=True, verified=True)
        warn_of_other_runs(bus, effective.run)
        while not stop.is_set():
            try:
                answer = matches.get(0.1)
            except MessageError as error:
                count_refused(matches.counts, error)
                bus.log_dropped("match", error)
                continue
            if answer is not None:
                print(printed(*answer), flush=True)
    if others := matches.counts["other_map"]:
        log.warning("%s of another map refused", counted(others, "message"))


def _as_line(
    header: Header,
    match: MatchMessage | None,
    precision: float,
    graphs: "Mapping[str, RouteGraph]",
) -> str:
    if match is None:
        return f"end of stream {header.stream[:8]}: {header.sequence} frames"
    kind = kind_of(match)
    frame = f"{'' if kind == 'causal' else f'  {kind} '}frame {header.sequence}"
    parts = [f"{frame}: {_place_of(match, graphs)}"]
    if match.new is None:
        parts.append(f"score {match.score:.2f}")
    if _is_new(match):
        parts.append(percent(match.new or 0.0))
    elif match.probability is not None:
        asked = "" if match.known or match.too_fast else f" ({100 * precision:g} % asked)"
        parts.append(f"{certainty_of(match)}, {percent(match.probability)}{asked}")
    if match.pose is not None:
        x, y, yaw = match.pose
        parts.append(f"at x {x:.2f} m, y {y:.2f} m, yaw {yaw:.2f} rad")
    if match.missing:
        parts.append(f"without channels {', '.join(map(str, match.missing))}")
    if match.forgotten:
        parts.append("part of the stream was forgotten")
    if isinstance(match, SmoothedMessage):
        parts.append(f"{match.lag} frames later")
    if isinstance(match, VerifiedMessage):
        parts += _verification(match)
    return ", ".join(parts)


def _verification(match: VerifiedMessage) -> list[str]:
    if match.reason is not None:
        return [f"not verified: {WORDS[match.reason]}"]
    parts = [f"{match.inliers} inliers, {match.ratio:.3g} times as likely"]
    return parts if match.relative is None else [*parts, _distance(match.relative)]


def _distance(relative: RelativePoseMessage) -> str:
    if relative.distance_m is None:
        return "pose relative to the place"
    return f"{relative.distance_m:.2f} ± {relative.deviation_m:.2f} m from the place"


def _place_of(match: MatchMessage, graphs: "Mapping[str, RouteGraph]") -> str:
    """Return the words for a place; where a drive is explored, the place is one of its frames."""
    if match.new is not None:
        return "new place" if _is_new(match) else f"place of frame {match.place}"
    return place_words(match.place, graphs.get(match.map or ""))


def _is_new(match: MatchMessage) -> bool:
    """Whether a place of an explored drive is more likely new than that of an earlier frame."""
    return match.new is not None and match.new > (match.probability or 0.0)


def _as_json(header: Header, match: MatchMessage | None) -> str:
    return json.dumps(as_object(header, match))
