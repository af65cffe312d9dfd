"""``placefield up``: all services of a host."""

import signal
import tempfile
import threading
from collections.abc import Hashable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from placefield_tools.cli import options, options_map
from placefield_tools.common.own_command import PLACEFIELD

if TYPE_CHECKING:
    from placefield.config import Config

_ROLES = {
    "featurizer": "featurizer",
    "channel": "channel",
    "fuser": "fuser",
    "serve": "mapserver",
}
"""The role whose credentials a command needs."""


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
        typer.Option(min=1, help="channel workers", show_default="one per core; 1 with --explore"),
    ] = None,
    verifiers: Annotated[
        int,
        typer.Option(min=0, help="verifiers of smoothed matches; the map needs local features"),
    ] = 0,
    run: options.Runs = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    feature: options_map.Feature = None,
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

    With --verifiers, smoothed matches are verified by geometry; see 'placefield verifier -h'.

    With several runs, each core has a featurizer and a fuser for some of the runs.

    A service that dies is started again. Ctrl-C stops all services. A new version of the map that
    replaces MAP is taken over, and no frame is lost.

    With --explore there is no map yet. Each frame is matched with the earlier ones of its stream:
    it shows the place of one of them, or a new place. At the end of the stream, or at Ctrl-C, the
    map is built of the frames and saved; further streams are matched with it. --feature is for
    --explore.

    Examples:
      placefield up route.pfmap --precision 0.99
      placefield up --explore warehouse.pfmap
      placefield up street.pfmap --ros /camera/image_raw/compressed --connect tcp/127.0.0.1:7447
    """
    from placefield.errors import ConfigError
    from placefield.maps.manifest import read_manifest
    from placefield.maps.route_graph import check_rule
    from placefield_services.host import run_host
    from placefield_services.process import stop_event
    from placefield_tools.common.parallel import cores

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
    if ros_odometry is not None and ros is None:
        raise ConfigError("--ros-odometry: needs images; give --ros, too")
    if ros_spacing is not None and ros_odometry is None:
        raise ConfigError("--ros-spacing: needs odometry; give --ros-odometry, too")
    if (map_path is None) == (explore is None):
        raise ConfigError("give a MAP, or --explore NAME.pfmap")
    if explore is None and feature is not None:
        raise ConfigError("--feature: is for --explore; a map has its own feature")
    if explore is not None and ros is not None:
        raise ConfigError("--ros: needs a map; explore without it, then start again with the map")
    if explore is not None and (verifiers or effective.build.local_features):
        flag = "--verifiers" if verifiers else "setting build.local_features"
        raise ConfigError(
            f"{flag}: an explored drive keeps no images, so its map has no local features; build a "
            "map of the frames with 'placefield build'"
        )
    if explore is not None:
        if not _explored(explore, effective, workers or 1, stop, log_json=log_json):
            return
        map_path = explore
    assert map_path is not None
    options_map.check_preset(effective, map_path)
    manifest = read_manifest(map_path)
    manifest.features.check_rule(effective.matching.rule)
    check_rule(effective.matching.rule, len(manifest.routes))
    channels = manifest.channels
    runs = ", ".join(map(repr, effective.runs))
    replaying = "" if ros else "'placefield replay SOURCE' and "

    def ready() -> None:
        print(
            f"ready: {'run' if len(effective.runs) == 1 else 'runs'} {runs} at "
            f"{effective.bus.endpoint}, {len(channels)} channels; "
            f"now {replaying}'placefield listen'",
            flush=True,
        )

    roles = _ROLES | ({"verifier": "verifier"} if verifiers else {})
    others = [*(["replay"] if ros else []), *(["verifier"] if verifiers else [])]
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        common = [str(map_path), *_common_flags(effective, Path(folder), log_json=log_json)]
        commands = _commands(
            common,
            partition([channel.metric for channel in channels], workers or cores()),
            [[effective.runs[run] for run in own] for own in partition(effective.runs, cores())],
            _credentials_beside(effective.bus.credentials, roles),
            manifest.lineage,
            verifiers,
        )
        if ros is not None:
            commands["gateway to ROS 2"] = _ros_command(
                common, ros, ros_odometry, ros_spacing, ros_domain, manifest.lineage
            )
        run_host(
            commands,
            len(channels),
            effective,
            stop,
            ready,
            others=others,
        )


def _explored(
    path: Path, effective: "Config", workers: int, stop: threading.Event, *, log_json: bool
) -> bool:
    """Explore a drive; return whether its map is there, and is to be served."""
    from placefield_tools.explore.exploring_host import check_explored, commands_of, explore

    check_explored(path, effective)
    with tempfile.TemporaryDirectory(prefix="placefield-") as folder:
        common = _common_flags(effective, Path(folder), log_json=log_json)
        services = ("featurizer", "channel", "fuser", "mapper")
        credentials = _credentials_beside(
            effective.bus.credentials, {service: service for service in services}
        )
        commands = commands_of(path, workers, common, credentials)
        is_there = explore(path, effective, commands, stop, _end_at_next_signal)
        return is_there and not stop.is_set()


def _end_at_next_signal() -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)


def _common_flags(effective: "Config", folder: Path, *, log_json: bool) -> list[str]:
    """Return the flags of all services; their configuration is written to a file in a folder."""
    from placefield.config import MonitoringConfig

    file = folder / "config.toml"
    # The host reports the metrics of all services at one port.
    of_services = effective.model_copy(update={"monitoring": MonitoringConfig()})
    file.write_text(of_services.to_toml())
    return ["--config", str(file), *(["--log-json"] if log_json else [])]


def partition(kinds: Sequence[Hashable], processes: int) -> list[list[int]]:
    """Partition items evenly among processes, and return the item numbers of each process.

    Items of one kind stay together if possible: a frame is compared only once for all channels of
    one metric.

    Args:
        kinds: kind of each item.
        processes: number of processes; there are at most as many as items.
    """
    first_of_kind = {kind: first for first, kind in reversed(list(enumerate(kinds)))}
    in_order = sorted(range(len(kinds)), key=lambda number: first_of_kind[kinds[number]])
    processes = min(processes, len(kinds))
    ends = [len(kinds) * process // processes for process in range(processes + 1)]
    return [sorted(in_order[start:end]) for start, end in pairwise(ends)]


def _credentials_beside(routers: str | None, roles: Mapping[str, str]) -> dict[str, Path]:
    """Return the folders of the services' credentials, which are beside the router's.

    Args:
        routers: the folder of the router's; None: there are no credentials.
        roles: the role of each command.

    Raises:
        BusError: credentials are missing or not valid. Each service would fail for the same reason.
    """
    from placefield.bus.credentials import tls_settings

    if routers is None:
        return {}
    beside = Path(routers).resolve().parent
    credentials = {command: beside / role for command, role in roles.items()}
    for folder in credentials.values():
        tls_settings(folder)
    return credentials


def _commands(
    common: Sequence[str],
    channels: Sequence[Sequence[int]],
    runs: Sequence[Sequence[str]],
    credentials: Mapping[str, Path],
    lineage: str,
    verifiers: int = 0,
) -> dict[str, list[str]]:
    """Return the command line of each service, by its name.

    There is one worker for each group of channels, one featurizer and one fuser for each group of
    runs, one map server, and so many verifiers. ``credentials`` has folders by command. A restarted
    service opens the version of the map that is there then, and refuses a map of another lineage.
    """

    def command(service: str, flag: str, own: Sequence[object]) -> list[str]:
        flags = [part for value in own for part in (flag, str(value))]
        if service != "serve":  # the map server sends any map
            flags += ["--lineage", lineage]
        if service in credentials:
            flags += ["--credentials", str(credentials[service])]
        return [*PLACEFIELD, service, *common, *flags]

    commands = {}
    for number, own_runs in enumerate(runs):
        commands[f"featurizer {number}"] = command("featurizer", "--run", own_runs)
        commands[f"fuser {number}"] = command("fuser", "--run", own_runs)
    for number, own_channels in enumerate(channels):
        commands[f"channel worker {number}"] = command("channel", "--channel", own_channels)
    for number in range(verifiers):
        commands[f"verifier {number}"] = command("verifier", "--run", [])
    commands["map server"] = command("serve", "--run", [])
    return commands


def _ros_command(
    common: Sequence[str],
    topic: str,
    odometry: str | None,
    spacing_m: float | None,
    domain: int,
    lineage: str,
) -> list[str]:
    flags = ["--topic", topic, "--domain", str(domain), "--lineage", lineage]
    if odometry is not None:
        flags += ["--odometry", odometry]
    if spacing_m is not None:
        flags += ["--spacing", str(spacing_m)]
    return [*PLACEFIELD, "ros", *common, *flags]
