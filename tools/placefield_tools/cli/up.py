"""``placefield up``: a whole host."""

import os
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("up")(_up)


def _up(
    map_path: options.MapPath,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="channel workers", show_default="one per core"),
    ] = None,
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    rule: options.RuleOption = None,
    precision: options.Precision = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Run a whole host: router, featurizer, channel workers and fuser.

    What dies is started again; Ctrl-C stops all.
    """
    from placefield.maps.store import open_map
    from placefield_services.host import run_host
    from placefield_services.process import stop_event

    stop = stop_event()
    effective = options.effective_config(
        config,
        settings,
        run=run,
        bus__endpoint=endpoint,
        matching__rule=rule,
        matching__precision=precision,
    )
    channels = len(open_map(map_path).channels)

    def ready() -> None:
        print(
            f"ready: run {effective.run!r} at {effective.bus.endpoint}, {channels} channels; "
            "now 'placefield replay SOURCE' and 'placefield listen'",
            flush=True,
        )

    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        file = Path(folder) / "config.toml"
        file.write_text(effective.to_toml())
        commands = _commands(map_path, channels, workers or os.cpu_count() or 1, file)
        run_host(commands, channels, effective, stop, ready)


def _commands(map_path: Path, channels: int, workers: int, config: Path) -> dict[str, list[str]]:
    """Return the command lines of the services; channels are dealt out to the workers in turn."""

    def command(service: str, *arguments: str) -> list[str]:
        program = [sys.executable, "-m", "placefield_tools"]
        return [*program, service, str(map_path), "--config", str(config), *arguments]

    commands = {"featurizer": command("featurizer"), "fuser": command("fuser")}
    for worker in range(min(workers, channels)):
        own = range(worker, channels, workers)
        flags = [flag for channel in own for flag in ("--channel", str(channel))]
        commands[f"channel worker {worker}"] = command("channel", *flags)
    return commands
