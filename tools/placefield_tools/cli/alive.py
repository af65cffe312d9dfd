"""``placefield alive``: whether a service is alive, for probes and scripts."""

from typing import Annotated, Literal

import typer

from placefield_tools.cli import options

_Service = Literal["featurizer", "describer", "channel", "fuser", "verifier", "mapserver", "mapper"]


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("alive")(_alive)


def _alive(
    service: Annotated[
        _Service | None,
        typer.Argument(help="a service; without it only the router is checked", show_default=False),
    ] = None,
    channel: Annotated[
        int | None, typer.Option(min=0, help="check the worker of this channel")
    ] = None,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Exit with code 0 if a service is alive in every run, else with code 1 and an error line.

    Examples:
      placefield alive fuser
      placefield alive channel --channel 2
    """
    from placefield.bus.connecting import open_bus
    from placefield.bus.keys import Keys, part_of, service_and_identity
    from placefield.errors import BusError, ConfigError

    if channel is not None and service != "channel":
        raise ConfigError("--channel: only for 'placefield alive channel'; leave it out")
    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, bus__credentials=credentials
    )
    with open_bus(effective.bus) as bus:
        if service is None:
            return
        for name in effective.runs:
            tokens = bus.alive(Keys(name).all_alive(service))
            found = bool(tokens)
            if channel is not None:
                parts = (part_of(service_and_identity(token)[1]) for token in tokens)
                found = any(part is not None and part.channel == channel for part in parts)
            if not found:
                wanted = service if channel is None else f"worker of channel {channel}"
                raise BusError(f"run {name!r} has no living {wanted}")
