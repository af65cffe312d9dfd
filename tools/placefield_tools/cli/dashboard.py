"""``placefield dashboard``: a run in the browser."""

from typing import Annotated

import typer

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("dashboard")(_dashboard)


def _dashboard(
    map_path: options.MapPath,
    run: options.Run = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="port of the pages")] = 8080,
    host: Annotated[
        str, typer.Option(help="address of the pages; 0.0.0.0: exposed to the network")
    ] = "127.0.0.1",
    name: Annotated[
        list[str] | None,
        typer.Option(
            help="a further name of this host in browsers, besides its own and its addresses; "
            "may be repeated",
            show_default=False,
        ),
    ] = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Show a run in the browser: its frames and matches, its services, and its map.

    The dashboard only listens. If it is too slow, it leaves frames out and does not block the
    pipeline. A new version that replaces MAP is shown from its first match on. Start on the page
    runs 'placefield replay' on this host. No internet is needed.

    Examples:
      placefield dashboard route.pfmap
      placefield dashboard route.pfmap --run night --port 8081
    """
    from placefield.bus.connecting import open_bus
    from placefield.bus.keys import Keys
    from placefield.errors import ConfigError
    from placefield_services.map_versions import MapVersions, PreparedVersions
    from placefield_services.process import stop_of_service
    from placefield_tools.dashboard.commands import Commands
    from placefield_tools.dashboard.feed import Feed
    from placefield_tools.dashboard.replay_process import ReplayChild, replay_flags
    from placefield_tools.dashboard.state import LiveState, ShownMap
    from placefield_tools.listen.match_queue import warn_of_other_runs

    try:
        from placefield_tools.dashboard.serving import serve
        from placefield_tools.dashboard.site import Site
    except ModuleNotFoundError as missing:
        raise ConfigError(
            f"dashboard needs {missing.name}: pip install 'placefield[dashboard]'"
        ) from None
    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, bus__credentials=credentials
    )
    run_name = effective.run
    versions = MapVersions(map_path, channels=None)
    state = LiveState(versions.open(), effective.matching.tolerance)
    replay = ReplayChild(replay_flags(run_name, effective.bus))
    stop = stop_of_service()  # until the pages are served, no one else looks at signals

    def ready() -> None:
        print(f"ready: run {run_name!r} at http://{host}:{port}", flush=True)

    with open_bus(effective.bus, stop, viewer=True) as bus:
        warn_of_other_runs(bus, run_name)
        prepared = PreparedVersions(versions, ShownMap.of)
        feed = Feed(bus, Keys(run_name), state, prepared.pop_all)
        commands = Commands(run_name, map_path, effective.bus.endpoint)
        precision = effective.matching.precision
        site = Site(commands, state, feed, replay, precision)
        try:
            serve(site, host, port, name or (), ready)
        finally:
            replay.close()
