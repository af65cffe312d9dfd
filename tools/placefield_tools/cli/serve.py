"""``placefield serve``: sends maps to hosts without them."""

from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("serve")(_serve)


def _serve(
    maps: Annotated[
        list[Path], typer.Argument(metavar="MAP...", help="maps: NAME.pfmap", show_default=False)
    ],
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    metrics_port: options.MetricsPort = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve maps to hosts without them; 'placefield up' also serves its map.

    Examples:
      placefield serve route.pfmap
    """
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield_services.mapserver import run_mapserver

    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        monitoring__port=metrics_port,
    )
    run_mapserver(maps, effective, stop_of_service())
    leave()
