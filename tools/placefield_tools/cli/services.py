"""``placefield featurizer``, ``channel`` and ``fuser``: one service each, on any host."""

from typing import Annotated

import typer

from placefield.config import FusionConfig
from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("featurizer")(_featurizer)
    app.command("channel")(_channel)
    app.command("fuser")(_fuser)


def _featurizer(
    map_path: options.MapPath,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve as featurizer: frames in, descriptors out."""
    from placefield.maps.opening import open_map
    from placefield_services.featurizer import run_featurizer
    from placefield_services.process import leave, stop_event

    effective = options.effective_config(config, settings, runs=run, bus__endpoint=endpoint)
    run_featurizer(open_map(map_path, channels=()), effective, stop_event())
    leave()


def _channel(
    map_path: options.MapPath,
    channel: Annotated[
        list[int], typer.Option(min=0, help="number of a channel of the map; may be repeated")
    ],
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    rule: options.RuleOption = None,
    exact: options.Exact = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve as channel worker: descriptors in, a candidate per channel out."""
    from placefield.maps.opening import open_map
    from placefield_services.channel import run_channels
    from placefield_services.process import leave, stop_event

    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        matching__rule=rule,
        matching__exact=exact,
    )
    run_channels(open_map(map_path, channels=channel), channel, effective, stop_event())
    leave()


def _fuser(
    map_path: options.MapPath,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    rule: options.RuleOption = None,
    precision: options.Precision = None,
    deadline: Annotated[
        float | None,
        typer.Option(
            help="for the candidates of a frame, seconds",
            show_default=f"{FusionConfig().deadline_s:g}",
        ),
    ] = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve as fuser: candidates in, one match per frame out."""
    from placefield.maps.opening import open_map
    from placefield_services.fuser import run_fuser
    from placefield_services.process import leave, stop_event

    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        matching__rule=rule,
        matching__precision=precision,
        fusion__deadline_s=deadline,
    )
    run_fuser(open_map(map_path, channels=()), effective, stop_event())
    leave()
