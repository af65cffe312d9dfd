"""``placefield router``: a router for a bus of several hosts."""

import typer

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("router")(_router)


def _router(
    endpoint: options.Endpoint = None,
    connect: options.Connect = None,
    credentials: options.Credentials = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Run a router. Services of this host connect to it, and it connects to routers of other hosts.

    One host of each two connects to the other. A message that many services of a host read crosses
    the network once.

    Examples:
      placefield router --endpoint tcp/0.0.0.0:7557 --connect tcp/10.0.0.2:7557
    """
    from placefield_services.process import begin, leave, stop_of_service
    from placefield_services.router_process import run_router

    begin()
    stop = stop_of_service()
    bus = options.effective_config(
        config,
        settings,
        bus__endpoint=endpoint,
        bus__connect=connect,
        bus__credentials=credentials,
    ).bus
    run_router(bus, stop, lambda: print(f"ready: router at {bus.endpoint}", flush=True))
    leave()
