"""``placefield up``: a whole host."""

import os
import sys
import tempfile
from collections.abc import Hashable, Sequence
from itertools import pairwise
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
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    rule: options.RuleOption = None,
    precision: options.Precision = None,
    exact: options.Exact = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Run a whole host: router, featurizer, channel workers and fuser.

    What dies is started again; Ctrl-C stops all.
    """
    from placefield.maps.opening import open_map
    from placefield_services.host import run_host
    from placefield_services.process import stop_event

    stop = stop_event()
    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        matching__rule=rule,
        matching__precision=precision,
        matching__exact=exact,
    )
    channels = open_map(map_path).channels
    runs = ", ".join(map(repr, effective.runs))

    def ready() -> None:
        print(
            f"ready: {'run' if len(effective.runs) == 1 else 'runs'} {runs} at "
            f"{effective.bus.endpoint}, {len(channels)} channels; "
            "now 'placefield replay SOURCE' and 'placefield listen'",
            flush=True,
        )

    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        file = Path(folder) / "config.toml"
        file.write_text(effective.to_toml())
        dealt = deal([c.metric for c in channels], workers or os.cpu_count() or 1)
        run_host(_commands(map_path, dealt, file), len(channels), effective, stop, ready)


def deal(metrics: Sequence[Hashable], workers: int) -> list[list[int]]:
    """Deal channels, given the metric of each, to workers as evenly as it goes.

    Channels of one metric stay together where they can: frames are compared under it once.
    """
    first_of_metric = {metric: first for first, metric in reversed(list(enumerate(metrics)))}
    in_order = sorted(range(len(metrics)), key=lambda channel: first_of_metric[metrics[channel]])
    workers = min(workers, len(metrics))
    ends = [len(metrics) * worker // workers for worker in range(workers + 1)]
    return [sorted(in_order[start:end]) for start, end in pairwise(ends)]


def _commands(map_path: Path, dealt: Sequence[Sequence[int]], config: Path) -> dict[str, list[str]]:
    """Return the command lines of the services, with a worker for each lot of channels."""

    def command(service: str, *arguments: str) -> list[str]:
        program = [sys.executable, "-m", "placefield_tools"]
        return [*program, service, str(map_path), "--config", str(config), *arguments]

    commands = {"featurizer": command("featurizer"), "fuser": command("fuser")}
    for worker, own in enumerate(dealt):
        flags = [flag for channel in own for flag in ("--channel", str(channel))]
        commands[f"channel worker {worker}"] = command("channel", *flags)
    return commands
