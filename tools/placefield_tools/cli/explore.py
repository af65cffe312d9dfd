"""``placefield explore``: one service of an exploration, on any host."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from placefield_tools.cli import options, options_frames, options_map

_Service = Literal["featurizer", "describer", "channel", "fuser", "mapper"]


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("explore")(_explore)


def _explore(
    service: Annotated[_Service, typer.Argument(help="the service", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="MAP",
            help="mapper: the map to be built, NAME.pfmap; the frames are kept beside it",
            show_default=False,
        ),
    ] = None,
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    feature: options_map.Feature = None,
    camera: options_frames.Camera = None,
    precision: options_map.Precision = None,
    metrics_port: options.MetricsPort = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Serve a drive without a map, as one of the services that 'placefield up --explore' starts.

    Several workers (channel) answer the same. The mapper keeps the frames of the drive. All
    services need the same --feature and --camera.

    Examples:
      placefield explore channel --endpoint tcp/robot:7557
    """
    from placefield.errors import ConfigError
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield_services.exploring_channel import run_exploring_channel
    from placefield_services.exploring_services import (
        run_exploring_describer,
        run_exploring_featurizer,
        run_exploring_fuser,
    )
    from placefield_services.mapper import run_mapper
    from placefield_tools.common.outputs import check_folder_of

    effective = options.effective_config(
        config,
        settings,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        features__kind=feature,
        matching__precision=precision,
        monitoring__port=metrics_port,
    )
    calibration = options_frames.calibration_of(camera)
    stop = stop_of_service()
    if service == "mapper":
        if output is None:
            raise ConfigError("--output: say which map the mapper keeps the frames for")
        check_folder_of(output)
        run_mapper(output, effective, calibration, stop)
    else:
        serve = {
            "featurizer": run_exploring_featurizer,
            "describer": run_exploring_describer,
            "channel": run_exploring_channel,
            "fuser": run_exploring_fuser,
        }[service]
        serve(effective, calibration, stop)
    leave()
