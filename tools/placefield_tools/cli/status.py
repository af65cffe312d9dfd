"""``placefield status``: the services of a run, their progress, and which are missing."""

import json
import logging
import threading
import time
from collections import Counter
from contextlib import nullcontext
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from placefield_tools.cli import options

if TYPE_CHECKING:
    from rich.console import RenderableType

    from placefield_tools.status.service_status import RunStatus, ServiceStatus
    from placefield_tools.status.statistics import RunListener

log = logging.getLogger(__name__)

_LISTEN_S = 2.3  # services report once a second, and a rate needs two reports
_REFRESH_S = 1.0


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("status")(_status)


def _status(
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    watch: Annotated[bool, typer.Option("--watch", help="refresh until Ctrl-C")] = False,
    json_: options.Json = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Print the services of a run, their progress, and which are missing.

    For each service: its newest answer, how many frames it is behind, its frames per second and its
    counts.

    The exit code is 1 if a featurizer, fuser, channel or a shard is missing. The error names it.

    Examples:
      placefield status --watch
      placefield status --run rear --json
    """
    from rich.console import Console

    from placefield.bus.connecting import open_bus
    from placefield.bus.keys import Keys
    from placefield.errors import BusError, ConfigError
    from placefield_services.process import stop_event
    from placefield_tools.listen.match_queue import warn_of_other_runs
    from placefield_tools.status.service_status import other_runs
    from placefield_tools.status.statistics import RunListener, RunsListener

    if watch and json_:
        raise ConfigError("--watch and --json: give one of them")
    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, bus__credentials=credentials
    )
    name = effective.run
    stop = stop_event() if watch else None
    with open_bus(effective.bus, stop) as bus:
        if stop:  # ask before subscribing: otherwise only the subscriber may get the answer
            warn_of_other_runs(bus, name)
        runs = RunsListener(bus)  # a busy router may answer late
        listener = RunListener(bus, Keys(name), lambda key, error: None)
        bus.subscribe(Keys(name).feature, listener.announce, Counter())
        if stop:
            _watch(listener, name, stop)
            return
        time.sleep(_LISTEN_S)
        status = listener.status()
        others = None if status.services else other_runs(name, runs.runs | bus.runs())
    if json_:
        print(json.dumps({"run": name, **asdict(status)}))
    else:
        Console(markup=False, highlight=False).print(_table(status, name))
    if listener.left_out:
        log.warning(
            "run %r: left out %d surplus tokens or senders without a token: no services",
            name,
            listener.left_out,
        )
    if status.missing:
        hint = f"; {others}" if others else ""
        raise BusError(f"run {name!r} lacks {'; '.join(status.missing)}{hint}")


def _watch(listener: "RunListener", run: str, stop: threading.Event) -> None:
    """Show the status again and again: in place at a terminal, else as a new table each time."""
    from rich.console import Console, Group
    from rich.live import Live

    def shown() -> "RenderableType":
        status = listener.status()
        absent = "; ".join(status.missing)
        return Group(_table(status, run), f"missing: {absent}" if absent else "complete")

    console = Console(markup=False, highlight=False)
    can_redraw = console.is_terminal and not console.is_dumb_terminal
    with Live(console=console, auto_refresh=False) if can_redraw else nullcontext() as live:
        while not stop.wait(_REFRESH_S):
            if live:
                live.update(shown(), refresh=True)
            else:
                console.print(shown())


def _table(status: "RunStatus", run: str) -> "RenderableType":
    from rich.table import Table

    newest = "no frame yet" if status.newest is None else f"newest frame {status.newest}"
    table = Table(title=f"run {run}, {newest}")
    for column in ("service", "identity"):
        table.add_column(column, no_wrap=True)
    for column in ("frame", "behind", "frames/s"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("counts")
    for service in status.services:
        table.add_row(service.service, service.identity, *_cells(service))
    return table


def _cells(service: "ServiceStatus") -> tuple[str, str, str, str]:
    from placefield_tools.status.service_status import counts_in_words

    rate = "" if service.rate is None else f"{service.rate:.1f}"
    return (
        "" if service.sequence is None else str(service.sequence),
        "" if service.behind is None else str(service.behind),
        "silent" if service.silent else rate,
        counts_in_words(service.counts),
    )
