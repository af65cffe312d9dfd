"""``placefield up``: all services of a host."""

import signal
import tempfile
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from placefield_tools.cli import options, options_frames, options_map

if TYPE_CHECKING:
    from placefield.config import Config
    from placefield.features.calibration import Calibration
    from placefield_tools.up.service_commands import ServiceFlags


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("up")(_up)


def _up(
    map_path: Annotated[
        Path | None,
        typer.Argument(metavar="MAP", help="a map: NAME.pfmap", show_default=False),
    ] = None,
    explore: Annotated[
        Path | None,
        typer.Option(
            metavar="NAME.pfmap",
            help="explore a drive without a map; at its end the map is saved here, and served",
            show_default=False,
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="channel workers",
            show_default="one per core, and at most one per metric under filter; 1 with --explore",
        ),
    ] = None,
    describers: Annotated[
        int, typer.Option(min=0, help="processes that compute features besides the featurizer")
    ] = 0,
    verifiers: Annotated[
        int,
        typer.Option(min=0, help="verifiers of smoothed matches; the map needs local features"),
    ] = 0,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    feature: options_map.Feature = None,
    camera: options_frames.Camera = None,
    preset: options_map.PresetOption = None,
    rule: options_map.RuleOption = None,
    precision: options_map.Precision = None,
    exact: options_map.Exact = None,
    ros: Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC",
            help="ROS 2 topic of images to use as frames; see 'placefield ros -h'",
            show_default="none",
        ),
    ] = None,
    ros_odometry: Annotated[
        str | None,
        typer.Option(metavar="TOPIC", help="ROS 2 topic of nav_msgs/Odometry", show_default="none"),
    ] = None,
    ros_spacing: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="use one image per so many metres, by odometry",
            show_default="every image",
        ),
    ] = None,
    ros_domain: Annotated[
        int, typer.Option(envvar="ROS_DOMAIN_ID", min=0, help="domain of ROS 2")
    ] = 0,
    connect: options.Connect = None,
    metrics_port: options.MetricsPort = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Run all services of a host: router, featurizer, channel workers and fuser.

    With several runs, each core has a featurizer and a fuser for some of the runs. If the feature
    is slow, --describers computes it on several cores; each describer serves all runs. With
    --verifiers, smoothed matches are verified by geometry; see 'placefield verifier -h'.

    A service that dies is started again. Ctrl-C stops all services. A new version of the map that
    replaces MAP is taken over, and no frame is lost.

    With --explore there is no map yet. Each frame is matched with the earlier ones of its stream:
    it shows the place of one of them, or a new place. At the end of the stream, or at Ctrl-C, the
    map is built of the frames and saved; further streams are matched with it. With --ros, too, the
    images of ROS are explored until Ctrl-C. --feature is for --explore.

    --camera is that of the explored drive, and of the images of --ros. Other frames have that of
    'placefield replay --camera'.

    Examples:
      placefield up route.pfmap --precision 0.99
      placefield up --explore warehouse.pfmap
      placefield up street.pfmap --ros /camera/image_raw/compressed --connect tcp/127.0.0.1:7447
    """
    from placefield.errors import ConfigError
    from placefield_services.process import stop_event
    from placefield_tools.up.service_commands import ServiceFlags, camera_flags, common_flags

    stop = stop_event()
    effective = options.effective_config(
        config,
        settings,
        preset=preset,
        runs=run,
        bus__endpoint=endpoint,
        bus__credentials=credentials,
        bus__connect=connect,
        monitoring__port=metrics_port,
        features__kind=feature,
        matching__rule=rule,
        matching__precision=precision,
        matching__exact=exact,
    )
    gateway = _gateway_flags(ros, ros_odometry, ros_spacing, ros_domain)
    if explore is None and feature is not None:
        raise ConfigError("--feature: is for --explore; a map has its own feature")
    if explore is None and ros is None and camera is not None:
        raise ConfigError(
            "--camera: is for --explore and --ros; give it to 'placefield replay', whose frames "
            "the services rectify"
        )
    if explore is not None and (verifiers or effective.build.local_features):
        flag = "--verifiers" if verifiers else "setting build.local_features"
        raise ConfigError(
            f"{flag}: an explored drive keeps no images, so its map has no local features; build a "
            "map of the frames with 'placefield build'"
        )
    calibration = options_frames.calibration_of(camera, ros)
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        common = common_flags(effective, Path(folder), log_json=log_json)
        own = camera_flags(calibration, Path(folder))
        flags = ServiceFlags(common, gateway, workers, describers, verifiers, own)
        if explore is not None and map_path is None:
            if not _explored(explore, effective, calibration, flags, stop):
                return
            map_path = explore
        elif map_path is None or explore is not None:
            raise ConfigError("give a MAP, or --explore NAME.pfmap")
        _serve(map_path, effective, flags, stop)


def _gateway_flags(
    topic: str | None, odometry: str | None, spacing_m: float | None, domain: int
) -> list[str] | None:
    """Return the flags of the gateway to ROS 2; None if there is no topic of images."""
    from placefield.errors import ConfigError

    if odometry is not None and topic is None:
        raise ConfigError("--ros-odometry: needs images; give --ros, too")
    if spacing_m is not None and odometry is None:
        raise ConfigError("--ros-spacing: needs odometry; give --ros-odometry, too")
    if topic is None:
        return None
    flags = ["--topic", topic, "--domain", str(domain)]
    if odometry is not None:
        flags += ["--odometry", odometry]
    if spacing_m is not None:
        flags += ["--spacing", str(spacing_m)]
    return flags


def _explored(
    path: Path,
    effective: "Config",
    camera: "Calibration | None",
    flags: "ServiceFlags",
    stop: threading.Event,
) -> bool:
    """Explore a drive; return whether its map is there, and is to be served."""
    from placefield_tools.explore.explored_map import AskedMap
    from placefield_tools.explore.exploring_host import check_explored, explore
    from placefield_tools.up.service_commands import exploring_commands

    asked = AskedMap(path, effective, camera)
    check_explored(asked)
    commands = exploring_commands(path, effective, flags)
    return explore(asked, commands, stop, _end_at_next_signal) and not stop.is_set()


def _end_at_next_signal() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)


def _serve(
    map_path: Path, effective: "Config", flags: "ServiceFlags", stop: threading.Event
) -> None:
    """Serve a map until ``stop`` is set."""
    from placefield.maps.manifest import read_manifest
    from placefield.maps.route_graph import check_rule
    from placefield_services.host import run_host
    from placefield_tools.up.program import PROGRAM
    from placefield_tools.up.service_commands import commands_on_map

    options_map.check_preset(effective, map_path)
    manifest = read_manifest(map_path)
    manifest.features.check_rule(effective.matching.rule)
    check_rule(effective.matching.rule, len(manifest.routes))
    runs = ", ".join(map(repr, effective.runs))
    replaying = "" if flags.sources else "'placefield replay SOURCE' and "

    def ready() -> None:
        print(
            f"ready: {'run' if len(effective.runs) == 1 else 'runs'} {runs} at "
            f"{effective.bus.endpoint}, {len(manifest.channels)} channels; "
            f"now {replaying}'placefield listen'",
            flush=True,
        )

    commands = commands_on_map(map_path, manifest, effective, flags)
    channels = len(manifest.channels)
    run_host(PROGRAM, commands, channels, effective, stop, ready, others=flags.others)
