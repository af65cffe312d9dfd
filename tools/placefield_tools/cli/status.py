"""``placefield status``: the services of a run, how far each is, and what is missing."""

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

    from placefield_tools.status.service_status import RunStanding, ServiceStanding
    from placefield_tools.status.statistics import RunListener

log = logging.getLogger(__name__)

_LISTEN_S = 2.3  # every service tells of itself once a second: twice make a rate
_REFRESH_S = 1.0


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("status")(_status)


def _status(
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    watch: Annotated[bool, typer.Option("--watch", help="go on until Ctrl-C")] = False,
    json_: options.Json = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Print the services of a run, how far each is, and what is missing.

    For each: its newest answer, by how many frames it is behind, frames per second, and counts.

    Ends with code 1 if a featurizer, a fuser, a channel or a shard is missing, saying which.

    Examples:
      placefield status --watch
      placefield status --run rear --json
    """
    from rich.console import Console

    from placefield.bus.keys import Keys
    from placefield.bus.session import open_bus
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
        if stop:  # asked before anything listens, else the answer may go to the listener alone
            warn_of_other_runs(bus, name)
        runs = RunsListener(bus)  # a router that is busy may be late with one answer
        listener = RunListener(bus, Keys(name), lambda key, error: None)
        bus.subscribe(Keys(name).feature, listener.announce, Counter())
        if stop:
            _watch(listener, name, stop)
            return
        time.sleep(_LISTEN_S)
        standing = listener.standing()
        others = None if standing.services else other_runs(name, runs.runs | bus.runs())
    if json_:
        print(json.dumps({"run": name, **asdict(standing)}))
    else:
        Console(markup=False, highlight=False).print(_table(standing, name))
    if listener.left_out:
        log.warning(
            "run %r: left out %d tokens, and senders that have none: they are no services",
            name,
            listener.left_out,
        )
    if standing.missing:
        hint = f"; {others}" if others else ""
        raise BusError(f"run {name!r} lacks {'; '.join(standing.missing)}{hint}")


def _watch(listener: "RunListener", run: str, stop: threading.Event) -> None:
    """Show how the run stands: in place at a terminal, else one table below the other."""
    from rich.console import Console, Group
    from rich.live import Live

    def shown() -> "RenderableType":
        standing = listener.standing()
        lacking = "; ".join(standing.missing)
        return Group(_table(standing, run), f"missing: {lacking}" if lacking else "complete")

    console = Console(markup=False, highlight=False)
    can_redraw = console.is_terminal and not console.is_dumb_terminal
    with Live(console=console, auto_refresh=False) if can_redraw else nullcontext() as live:
        while not stop.wait(_REFRESH_S):
            if live:
                live.update(shown(), refresh=True)
            else:
                console.print(shown())


def _table(standing: "RunStanding", run: str) -> "RenderableType":
    from rich.table import Table

    newest = "no frame yet" if standing.newest is None else f"newest frame {standing.newest}"
    table = Table(title=f"run {run}, {newest}")
    for column in ("service", "identity"):
        table.add_column(column, no_wrap=True)
    for column in ("frame", "behind", "frames/s"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("counts")
    for service in standing.services:
        table.add_row(service.service, service.identity, *_cells(service))
    return table


def _cells(service: "ServiceStanding") -> tuple[str, str, str, str]:
    from placefield_tools.status.service_status import counts_in_words

    rate = "" if service.rate is None else f"{service.rate:.1f}"
    return (
        "" if service.sequence is None else str(service.sequence),
        "" if service.behind is None else str(service.behind),
        "silent" if service.silent else rate,
        counts_in_words(service.counts),
    )
