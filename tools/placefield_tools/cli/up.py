"""``placefield up``: a whole host."""

import sys
import tempfile
from collections.abc import Hashable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options

_ROLES = {
    "featurizer": "featurizer",
    "channel": "channel",
    "fuser": "fuser",
    "serve": "mapserver",
}
"""Whose credentials a command needs."""


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
    credentials: options.Credentials = None,
    rule: options.RuleOption = None,
    precision: options.Precision = None,
    exact: options.Exact = None,
    metrics_port: options.MetricsPort = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Run a whole host: router, featurizer, channel workers and fuser.

    Of several runs each core's featurizer and fuser serve a share.

    What dies is started again; Ctrl-C stops all.
    """
    from placefield.config import MonitoringConfig
    from placefield.maps.manifest import read_manifest
    from placefield_services.host import run_host
    from placefield_services.process import stop_event
    from placefield_tools.parallel import cores

    stop = stop_event()
    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        monitoring__port=metrics_port,
        matching__rule=rule,
        matching__precision=precision,
        matching__exact=exact,
    )
    channels = read_manifest(map_path).channels
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
        # The host tells of them all, at the one port.
        own = effective.model_copy(update={"monitoring": MonitoringConfig()})
        file.write_text(own.to_toml())
        commands = _commands(
            [str(map_path), "--config", str(file), *(["--log-json"] if log_json else [])],
            deal([channel.metric for channel in channels], workers or cores()),
            [[effective.runs[run] for run in own] for own in deal(effective.runs, cores())],
            _credentials_beside(effective.bus.credentials),
        )
        run_host(commands, len(channels), effective, stop, ready)


def deal(kinds: Sequence[Hashable], processes: int) -> list[list[int]]:
    """Deal what there is, given the kind of each, to processes as evenly as it goes.

    What is of one kind stays together where it can: frames are compared once under the metric of
    several channels.
    """
    first_of_kind = {kind: first for first, kind in reversed(list(enumerate(kinds)))}
    in_order = sorted(range(len(kinds)), key=lambda number: first_of_kind[kinds[number]])
    processes = min(processes, len(kinds))
    ends = [len(kinds) * process // processes for process in range(processes + 1)]
    return [sorted(in_order[start:end]) for start, end in pairwise(ends)]


def _credentials_beside(routers: str | None) -> dict[str, Path]:
    """Return the folders of the services' credentials, which lie beside the router's.

    Raises:
        BusError: one is missing or does not fit, which each service would find by itself.
    """
    from placefield.bus.credentials import tls_settings

    if routers is None:
        return {}
    beside = Path(routers).resolve().parent
    credentials = {command: beside / role for command, role in _ROLES.items()}
    for folder in credentials.values():
        tls_settings(folder)
    return credentials


def _commands(
    common: Sequence[str],
    channels: Sequence[Sequence[int]],
    runs: Sequence[Sequence[str]],
    credentials: Mapping[str, Path],
) -> dict[str, list[str]]:
    """Return the command lines of the services, by a name for each.

    There is a worker for each lot of channels, a featurizer and a fuser for each lot of runs, and
    one map server. The credentials are by command; none where there are none.
    """

    def command(service: str, flag: str, own: Sequence[object]) -> list[str]:
        flags = [part for value in own for part in (flag, str(value))]
        if service in credentials:
            flags += ["--credentials", str(credentials[service])]
        return [sys.executable, "-m", "placefield_tools", service, *common, *flags]

    commands = {}
    for number, own_runs in enumerate(runs):
        commands[f"featurizer {number}"] = command("featurizer", "--run", own_runs)
        commands[f"fuser {number}"] = command("fuser", "--run", own_runs)
    for number, own_channels in enumerate(channels):
        commands[f"channel worker {number}"] = command("channel", "--channel", own_channels)
    commands["map server"] = command("serve", "--run", [])
    return commands
