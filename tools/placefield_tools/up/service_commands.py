"""The command lines of the services of a host."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path

from placefield.config import Config, MonitoringConfig, Rule
from placefield.features.calibration import Calibration
from placefield.features.camera_file import write_camera
from placefield.maps.manifest import Manifest
from placefield_tools.common.own_command import PLACEFIELD
from placefield_tools.common.parallel import cores

_ROLES = {
    "featurizer": "featurizer",
    "channel": "channel",
    "fuser": "fuser",
    "serve": "mapserver",
}
"""The role whose credentials a command needs, but for describers, which a host may not have."""

GATEWAY = "gateway to ROS 2"
"""The name of the gateway among the commands."""


@dataclass(frozen=True)
class ServiceFlags:
    """What the services of a host are started with, besides their own flags.

    Attributes:
        common: flags of all services.
        gateway: flags of the gateway to ROS 2; None: there is no gateway.
        workers: the number of channel workers; None: as many as suit the host.
        describers: the number of describers.
        verifiers: the number of verifiers.
        camera: flags that say the camera of the explored drive, and of the images of ROS.
    """

    common: Sequence[str]
    gateway: Sequence[str] | None = None
    workers: int | None = None
    describers: int = 0
    verifiers: int = 0
    camera: Sequence[str] = ()

    @property
    def sources(self) -> tuple[str, ...]:
        """The services of the host that are sources of frames."""
        return () if self.gateway is None else ("replay",)

    @property
    def others(self) -> tuple[str, ...]:
        """The services of the host besides featurizer, fuser and channel workers."""
        describers = ("describer",) if self.describers else ()
        return (*self.sources, *describers, *(("verifier",) if self.verifiers else ()))


def common_flags(config: Config, folder: Path, *, log_json: bool) -> list[str]:
    """Return the flags of all services; their configuration is written to a file in a folder."""
    file = folder / "config.toml"
    # The host reports the metrics of all services at one port.
    of_services = config.model_copy(update={"monitoring": MonitoringConfig()})
    file.write_text(of_services.to_toml())
    return ["--config", str(file), *(["--log-json"] if log_json else [])]


def camera_flags(camera: Calibration | None, folder: Path) -> list[str]:
    """Return the flags that say a camera, whose calibration is written to a file in a folder."""
    if camera is None:
        return []
    file = folder / "camera.yaml"
    write_camera(camera, file)
    return ["--camera", str(file)]


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


def _of_workers(metrics: Sequence[int], rule: Rule, workers: int | None) -> list[list[int]]:
    """Return the channels of each worker.

    Args:
        metrics: the metric of each channel.
        rule: under ``filter``, channels of one metric answer alike at the cost of one.
        workers: how many; None: one per core, as far as no two of them do the same work.
    """
    if workers is not None or rule != "filter":
        return partition(metrics, workers or cores())
    channels_of = [
        [channel for channel, own in enumerate(metrics) if own == metric]
        for metric in dict.fromkeys(metrics)
    ]
    return [
        sorted(chain.from_iterable(channels_of[number] for number in numbers))
        for numbers in partition(range(len(channels_of)), cores())
    ]


def commands_on_map(
    path: Path, manifest: Manifest, config: Config, flags: ServiceFlags
) -> dict[str, list[str]]:
    """Return the command line of each service that serves a map, by its name.

    There is one worker for each group of channels, one featurizer and one fuser for each group of
    runs, the describers of all runs, the verifiers, one map server, and the gateway. A restarted
    service opens the version of the map that is there then, and refuses a map of another lineage.

    Raises:
        BusError: credentials are missing or not valid.
    """
    optional = {"describer": flags.describers, "verifier": flags.verifiers}
    roles = _ROLES | {name: name for name, count in optional.items() if count}
    credentials = _credentials_beside(config.bus.credentials, roles)
    common, lineage = [str(path), *flags.common], ["--lineage", manifest.lineage]

    def command(service: str, *own: str) -> list[str]:
        if service in credentials:
            own = (*own, "--credentials", str(credentials[service]))
        return [*PLACEFIELD, service, *common, *own]

    commands = {}
    for number, runs in enumerate(partition(config.runs, cores())):
        own = [*_repeated("--run", [config.runs[run] for run in runs]), *lineage]
        commands[f"featurizer {number}"] = command("featurizer", *own)
        commands[f"fuser {number}"] = command("fuser", *own)
    for number in range(flags.describers):
        own = [*_repeated("--run", config.runs), *lineage]
        commands[f"describer {number}"] = command("describer", *own)
    metrics = [channel.metric for channel in manifest.channels]
    for number, channels in enumerate(_of_workers(metrics, config.matching.rule, flags.workers)):
        own = [*_repeated("--channel", channels), *lineage]
        commands[f"channel worker {number}"] = command("channel", *own)
    for number in range(flags.verifiers):
        commands[f"verifier {number}"] = command("verifier", *lineage)
    commands["map server"] = command("serve")  # it sends any map
    if flags.gateway is not None:
        commands[GATEWAY] = command("ros", *flags.gateway, *flags.camera, *lineage)
    return commands


def exploring_commands(path: Path, config: Config, flags: ServiceFlags) -> dict[str, list[str]]:
    """Return the command line of each service that explores a drive, by its name.

    Args:
        path: of the map that will be built.
        config: its credentials count.
        flags: of the services.

    Raises:
        BusError: credentials are missing or not valid.
    """
    describer = ("describer",) if flags.describers else ()
    services = ("featurizer", *describer, "channel", "fuser", "mapper")
    credentials = _credentials_beside(config.bus.credentials, {each: each for each in services})

    def command(service: str, *own: str) -> list[str]:
        if service in credentials:
            own = (*own, "--credentials", str(credentials[service]))
        return [*PLACEFIELD, "explore", service, *flags.common, *flags.camera, *own]

    commands = {
        "featurizer": command("featurizer"),
        **{f"describer {number}": command("describer") for number in range(flags.describers)},
        **{f"channel worker {number}": command("channel") for number in range(flags.workers or 1)},
        "fuser": command("fuser"),
        "mapper": command("mapper", "--output", str(path)),
    }
    if flags.gateway is not None:
        commands[GATEWAY] = [*PLACEFIELD, "ros", *flags.common, *flags.gateway, *flags.camera]
    return commands


def _repeated(flag: str, values: Sequence[object]) -> list[str]:
    return [part for value in values for part in (flag, str(value))]


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
