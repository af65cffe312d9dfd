"""``placefield status``: the services of a run and what they counted."""

import threading
import time

import typer
from rich.console import Console
from rich.table import Table

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("status")(_status)


def _status(
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Print the services of a run that are alive, and what each has counted."""
    from placefield.bus.keys import Keys, service_and_identity
    from placefield.bus.messages import StatsMessage
    from placefield.bus.session import open_bus
    from placefield.errors import MessageError

    effective = options.effective_config(config, settings, runs=run, bus__endpoint=endpoint)
    keys = Keys(effective.run)
    counts: dict[tuple[str, str], dict[str, int]] = {}
    lock = threading.Lock()

    def receive(key: str, payload: bytes) -> None:
        try:
            stats = StatsMessage.decode(payload)
        except MessageError:
            return
        with lock:
            counts[service_and_identity(key)] = stats.counts

    with open_bus(effective.bus) as bus:
        bus.subscribe_raw(keys.all_stats, receive)
        time.sleep(1.5)  # every service publishes once a second
        alive = sorted(map(service_and_identity, bus.alive(keys.all_alive())))
    table = Table("service", "identity", "counts", title=f"run {effective.run}")
    with lock:
        for service, identity in alive:
            own = counts.get((service, identity.rpartition("-")[2]), {})
            table.add_row(service, identity, ", ".join(f"{k} {v}" for k, v in sorted(own.items())))
    Console(markup=False).print(table)
