"""``placefield fetch``: downloads a map from another host."""

from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("fetch")(_fetch)


def _fetch(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="name of a map that a host serves", show_default=False),
    ],
    to: Annotated[Path, typer.Option(help="folder for the map")] = Path(),
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Fetch a map from a host that serves it.

    The command stops if nothing comes for bus.connect_timeout_s. Run it again to continue where it
    stopped.

    Examples:
      placefield fetch route --endpoint tcp/10.0.0.2:7557
    """
    from placefield.bus.connecting import open_bus
    from placefield.errors import ConfigError
    from placefield.maps.manifest import SUFFIX
    from placefield_services.process import stop_event
    from placefield_tools.common.progress import progress_bar
    from placefield_tools.fetch.map_download import Fetch

    name = name.removesuffix(SUFFIX)
    if not name or "/" in name:
        raise ConfigError(f"{name!r}: give the name of a map; give its folder with --to")
    path = to / f"{name}{SUFFIX}"
    effective = options.effective_config(
        config, settings, bus__endpoint=endpoint, bus__credentials=credentials
    )
    stop = stop_event()
    with open_bus(effective.bus, stop) as bus, progress_bar() as bar:
        task = bar.add_task(f"fetching {path.name}", total=None)
        fetched, was_there = Fetch(bus, name, effective.bus, stop).into(
            path, lambda there, total: bar.update(task, completed=there, total=total)
        )
    words = f"{fetched.places.count} places, {len(fetched.channels)} channels"
    print(f"{path}: {'there already, ' if was_there else ''}{words}")
