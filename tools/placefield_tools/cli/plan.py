"""``placefield plan``: a proposal of processes per host, with the commands."""

import json
import math
import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from placefield.config import BusConfig
from placefield_tools.cli import options

if TYPE_CHECKING:
    from placefield_tools.plan.host_plan import Plan
    from placefield_tools.plan.process_cost import Process

_PORT = BusConfig().endpoint.rpartition(":")[2]


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("plan")(_plan)


def _plan(
    map_path: options.MapPath,
    hosts: Annotated[
        str, typer.Option(metavar="N or NAME,NAME...", help="number of hosts, or their names")
    ] = "1",
    cores: Annotated[int, typer.Option(min=1, help="cores of each host")] = 1,
    rate: Annotated[float, typer.Option(min=0.01, help="frames per second wanted")] = 30.0,
    memory: Annotated[
        float | None,
        typer.Option(metavar="GB", min=0.001, help="memory of each host", show_default="no limit"),
    ] = None,
    run: options.Run = None,
    json_: options.Json = False,
) -> None:
    """Propose which processes to run on which host, and print the commands of each host.

    The proposal is an estimate from the map's manifest, for the rule filter.

    The first host has featurizer and fuser. A core has at most one channel worker. If the
    featurizer alone is too slow for the rate, there are describers, too.

    Channels of one metric stay together. Channels are cut into shards only if the rate or the
    memory needs it.

    Each host needs the map at the same path: see 'placefield fetch'.

    The exit code is 1 if hosts, cores or memory are not enough.

    Examples:
      placefield plan route.pfmap --hosts camera,left,right --cores 4
      placefield plan city.pfmap --hosts 4 --cores 2 --memory 1.5
    """
    from placefield.maps.manifest import read_manifest
    from placefield_tools.plan.host_plan import plan, with_describers
    from placefield_tools.plan.process_cost import loads_of, services_of

    names = _names(hosts)
    memory_bytes = math.inf if memory is None else memory * 1e9
    manifest = read_manifest(map_path)
    sizes = _sizes(map_path, list(manifest.files))
    proposed = plan(
        loads_of(manifest, sizes),
        with_describers(services_of(manifest), rate, most=len(names) * cores - 1),
        manifest.places,
        hosts=len(names),
        cores=cores,
        rate=rate,
        memory_bytes=memory_bytes,
    )
    commands = [
        [_command(process, names, number, map_path, manifest.preset, run) for process in processes]
        for number, processes in enumerate(proposed.hosts)
    ]
    if json_:
        print(json.dumps(_figures(proposed, names, commands, rate, memory_bytes)))
    else:
        _print(proposed, names, commands, rate, memory_bytes)
    if not proposed.suffices(rate, memory_bytes):
        raise typer.Exit(1)


def _names(hosts: str) -> list[str]:
    """Return the names of the hosts; ``host1``, ``host2``, … if only their number is given.

    Raises:
        ConfigError: the text is neither distinct names nor a number above 0.
    """
    from placefield.errors import ConfigError

    if hosts.isdecimal() and int(hosts) > 0:
        return [f"host{number}" for number in range(1, int(hosts) + 1)]
    names = hosts.split(",")
    named = all(name and not name.isdecimal() and name.isprintable() for name in names)
    if not named or len(set(names)) < len(names):
        raise ConfigError(
            f"--hosts {hosts!r}: write their number, or their names with commas between"
        )
    return names


def _sizes(map_path: Path, files: Sequence[str]) -> dict[str, int]:
    from placefield.errors import MapError
    from placefield.maps.array_files import open_inside
    from placefield.maps.manifest import REBUILD

    sizes = {}
    for file in files:
        try:
            with open_inside(map_path, file) as opened:
                sizes[file] = os.fstat(opened.fileno()).st_size
        except OSError:
            raise MapError(f"{map_path / file}: missing or unreadable; {REBUILD}") from None
    return sizes


def _command(
    process: "Process",
    names: Sequence[str],
    host: int,
    map_path: Path,
    preset: str | None,
    run: str | None,
) -> str:
    """Return the command line of a process on a host; a single host has its bus on loopback."""
    endpoints = [f"tcp/{name}:{_PORT}" for name in names]
    flags = ["--endpoint", endpoints[host]] if len(names) > 1 else []
    if process.service == "router":
        connect = [part for other in endpoints[:host] for part in ("--connect", other)]
        return shlex.join(["placefield", "router", *flags, *connect])
    own = [part for channel in process.channels for part in ("--channel", str(channel))]
    if process.shards > 1:
        own += ["--shard", f"{process.shard}/{process.shards}"]
    if preset is not None and process.service in ("channel", "fuser"):
        own += ["--preset", preset]
    own += [] if run is None else ["--run", run]
    return shlex.join(["placefield", process.service, str(map_path), *own, *flags])


def _figures(
    proposed: "Plan",
    names: Sequence[str],
    commands: Sequence[Sequence[str]],
    rate: float,
    memory_bytes: float,
) -> dict[str, Any]:
    return {
        "rate": rate,
        "suffices": proposed.suffices(rate, memory_bytes),
        "highest_rate": proposed.highest_rate,
        "hosts": [
            {
                "name": name,
                "idle": _is_idle(processes),
                "memory_bytes": needed,
                "processes": [
                    {
                        "service": process.service,
                        "channels": process.channels,
                        "shard": process.shard,
                        "shards": process.shards,
                        "core_share": process.frame_s * rate,
                        "own_bytes": process.own_bytes,
                        "mapped_bytes": process.mapped_bytes,
                        "command": command,
                    }
                    for process, command in zip(processes, own, strict=True)
                ],
            }
            for name, processes, needed, own in zip(
                names, proposed.hosts, proposed.memory_bytes, commands, strict=True
            )
        ],
    }


def _print(
    proposed: "Plan",
    names: Sequence[str],
    commands: Sequence[Sequence[str]],
    rate: float,
    memory_bytes: float,
) -> None:
    from rich.console import Console
    from rich.table import Table

    from placefield_tools.plan.host_plan import ROOM

    console = Console(markup=False, highlight=False)
    table = Table(title=f"an estimate, at {rate:g} frames/s")
    table.add_column("host")
    table.add_column("process")
    for column in ("of a core", "own MB", "map's MB"):
        table.add_column(column, justify="right")
    for name, processes in zip(names, proposed.hosts, strict=True):
        if _is_idle(processes):
            table.add_row(name, "idle")
            continue
        for process in processes:
            table.add_row(
                name,
                _label(process),
                f"{process.frame_s * rate:.0%}",
                f"{process.own_bytes / 1e6:.0f}",
                f"{process.mapped_bytes / 1e6:.0f}" if process.mapped_bytes else "",
            )
        table.add_section()
    console.print(table)
    console.print(f"at most about {proposed.highest_rate:.0f} frames/s")
    if not proposed.has_time(rate):
        console.print(
            f"too few hosts or cores: at {rate:g} frames/s a core would be busy for more than "
            f"{ROOM:.0%} of the time; give more of them, or a lower --rate",
            soft_wrap=True,
        )
    if max(proposed.memory_bytes) > memory_bytes:
        console.print(
            f"too little memory: a host would need {max(proposed.memory_bytes) / 1e9:.1f} GB; "
            "give more hosts or cores, or more --memory",
            soft_wrap=True,
        )
    hosts = zip(names, proposed.hosts, proposed.memory_bytes, commands, strict=True)
    for name, processes, needed, own in hosts:
        if _is_idle(processes):
            console.print(f"\n{name} is idle: the others suffice.")
            continue
        console.print(f"\n{name}, about {needed / 1e9:.1f} GB of memory:")
        for command in own:
            console.print(f"  {command}", soft_wrap=True)


def _is_idle(processes: Sequence["Process"]) -> bool:
    return all(process.service == "router" for process in processes)


def _label(process: "Process") -> str:
    if process.service != "channel":
        return process.service
    numbers = ", ".join(map(str, process.channels))
    label = f"channel{'s' if len(process.channels) > 1 else ''} {numbers}"
    return label if process.shards == 1 else f"{label}, shard {process.shard}/{process.shards}"
