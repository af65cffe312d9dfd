"""Options that several commands share, and how flags become a configuration."""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from placefield.config import Config, Rule
from placefield.errors import ConfigError
from placefield.evaluation.protocols import (
    DEFAULT_EVERY,
    SHORT_REFERENCE,
    SHORT_SPEED_EVERY,
    SPEED_EVERY,
    TAKES_EVERY,
    Protocol,
)
from placefield.evaluation.truth import Truth, read_truth
from placefield.loading import load_config
from placefield.maps.manifest import read_manifest
from placefield.maps.trajectory import PoseAxes
from placefield.presets import Preset
from placefield_tools.common.log_format import log_as_json

_DEFAULTS = Config()


def _log_as_json(wanted: bool) -> bool:
    if wanted:
        log_as_json()
    return wanted


MapPath = Annotated[
    Path, typer.Argument(metavar="MAP", help="a map: NAME.pfmap", show_default=False)
]
ConfigFile = Annotated[
    Path | None, typer.Option("--config", help="settings as TOML; see 'placefield config'")
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="any setting, as scales.channels=8"),
]
Run = Annotated[
    str | None, typer.Option("--run", help="name of the run", show_default=_DEFAULTS.run)
]
Runs = Annotated[
    list[str] | None,
    typer.Option("--run", help="name of a run; may be repeated", show_default=_DEFAULTS.run),
]
Endpoint = Annotated[
    str | None,
    typer.Option(metavar="ENDPOINT", help="the router", show_default=_DEFAULTS.bus.endpoint),
]
Connect = Annotated[
    list[str] | None,
    typer.Option(metavar="ENDPOINT", help="a router of another host; may be repeated"),
]
Credentials = Annotated[
    str | None,
    typer.Option(
        metavar="FOLDER",
        help="of this role, as 'placefield security init' makes them",
        show_default=False,
    ),
]
MetricsPort = Annotated[
    int | None,
    typer.Option(
        "--metrics-port",
        metavar="PORT",
        help="where Prometheus finds the counts; --set monitoring.host=0.0.0.0 for others' eyes",
        show_default="none",
    ),
]
Digest = Annotated[
    str | None,
    typer.Option(
        metavar="DIGITS",
        help="serve no other map than this: first 16 of sha256sum MAP/manifest.json",
        show_default="any",
    ),
]
LogJson = Annotated[
    bool,
    typer.Option(
        "--log-json",
        help="log an object per line",
        callback=_log_as_json,
        is_eager=True,
    ),
]
PresetOption = Annotated[
    Preset | None,
    typer.Option(
        "--preset",
        help="many settings in one word: paper, AMS as published; see 'placefield config'",
        show_default=False,
    ),
]
RuleOption = Annotated[
    Rule | None,
    typer.Option("--rule", help="how places are matched", show_default=_DEFAULTS.matching.rule),
]
Exact = Annotated[
    bool | None,
    typer.Option(
        "--exact",
        help="compare with every place exactly, also where the map is built for a coarse look",
        show_default=False,
    ),
]
Precision = Annotated[
    float | None,
    typer.Option(
        metavar="P",
        help="a match that is right with at least this probability is known",
        show_default=f"{_DEFAULTS.matching.precision:g}",
    ),
]

Feature = Annotated[
    str | None,
    typer.Option(
        metavar="KIND",
        help="grayscale, gist, or onnx:FILE for a network",
        show_default=_DEFAULTS.features.kind,
    ),
]
Standardise = Annotated[
    bool | None,
    typer.Option(
        "--standardise/--no-standardise",
        help="take the query's running mean and deviation out",
        show_default="standardise" if _DEFAULTS.features.standardise else "no-standardise",
    ),
]
Channels = Annotated[
    int | None,
    typer.Option(help="how many", show_default=str(_DEFAULTS.scales.channels)),
]
Clusters = Annotated[int | None, typer.Option(help="per channel", show_default="estimated")]
PositionWeight = Annotated[
    float | None,
    typer.Option(
        help="of the position in the route when clustering; 0: the paper",
        show_default=f"{_DEFAULTS.scales.position_weight:g}",
    ),
]
MinScale = Annotated[
    str | None,
    typer.Option(
        metavar="N or Nm",
        help="shortest segment in frames, or in metres",
        show_default=str(_DEFAULTS.scales.min_scale),
    ),
]
Metric = Annotated[
    str | None,
    typer.Option(
        help="lmnn, rca, lfda, nca or identity; a learned one is kept where it helps",
        show_default=_DEFAULTS.metric.kind,
    ),
]
Seed = Annotated[
    int | None, typer.Option(help="of everything random", show_default=str(_DEFAULTS.seed))
]
Tolerance = Annotated[
    str | None,
    typer.Option(
        metavar="N or Nm",
        help="what is right is off by so many places, or metres by the poses of both sides",
        show_default=str(_DEFAULTS.matching.tolerance),
    ),
]
Aligned = Annotated[
    bool,
    typer.Option(
        "--aligned",
        help="query frame i shows place i (of a thinned reference i/n), whatever poses and counts "
        "say",
    ),
]
SameFrame = Annotated[
    bool,
    typer.Option(
        "--same-frame",
        help="the poses of REF and QUERY are in the same metres, and say what is right",
    ),
]
TruthFile = Annotated[
    Path | None,
    typer.Option(
        "--truth", help="ground truth as CSV: query,first,last, of frames before any thinning"
    ),
]
ProtocolOption = Annotated[
    Protocol, typer.Option("--protocol", help="how the query's frames are driven")
]
Every = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=1,
        help="take every N-th frame: --protocol speed, odometry and dense of the reference, sparse "
        "of the query",
        show_default=f"{DEFAULT_EVERY}; of speed and odometry {SPEED_EVERY}, or "
        f"{SHORT_SPEED_EVERY} where the reference has fewer than {SHORT_REFERENCE} frames",
    ),
]
Other = Annotated[
    str | None,
    typer.Option(
        metavar="SOURCE", help="frames of another route, that --protocol off-route leaves for"
    ),
]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object")]
Spacing = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        help="take a frame every so many metres, by odometry",
        show_default="every frame",
    ),
]
Start = Annotated[int, typer.Option("--start", metavar="N", help="the first frame, from 0")]
Stop = Annotated[
    int | None,
    typer.Option("--stop", metavar="N", help="the frame to end before", show_default="the end"),
]
Stride = Annotated[int, typer.Option("--stride", metavar="N", help="take every N-th frame")]
LeaveOutBad = Annotated[
    bool,
    typer.Option(
        "--leave-out-bad", help="build without frames that cannot be read, or did not come"
    ),
]
Topic = Annotated[
    str | None,
    typer.Option(
        metavar="TOPIC", help="of a recording: its images", show_default="the only one of images"
    ),
]
OdometryTopic = Annotated[
    str | None,
    typer.Option(
        metavar="TOPIC",
        help="of a recording: Odometry, PoseStamped or NavSatFix; none: no poses",
        show_default="the only one, if it is",
    ),
]
PoseFile = Annotated[
    Path | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="of the frames: TUM, joined by stamp if they have any, or KITTI, a line per frame",
        show_default=False,
    ),
]

PoseAxesOption = Annotated[
    PoseAxes | None,
    typer.Option(
        "--pose-axes",
        help="of --poses: a vehicle's, x forward and y on the left, or a camera's, z forward and x "
        "on the right",
        show_default="TUM x-forward, KITTI z-forward",
    ),
]

_METRES = re.compile(r"(\d+(?:\.\d+)?)\s*m")


def effective_config(file: Path | None, settings: Sequence[str] | None, **flags: Any) -> Config:
    """Make the configuration of a command.

    Args:
        file: of ``--config``.
        settings: of ``--set``.
        flags: values of the command's own flags by key, ``scales__channels``; None or []: none.

    Raises:
        ConfigError: something does not fit.
    """
    nested: dict[str, Any] = {}
    for key, value in [*map(_setting, settings or ()), *flags.items()]:
        if value is None or value == []:
            continue
        *sections, name = key.split("__")
        table = nested
        for section in sections:
            table = table.setdefault(section, {})
            if not isinstance(table, dict):
                raise ConfigError(f"--set {section}: is a section; set one of its keys")
        table[name] = value
    return load_config(file, nested)


def check_preset(config: Config, map_path: Path) -> None:
    """Refuse a map that was built without the preset in force, which sets more than matching.

    Raises:
        ConfigError: it was.
        MapError: there is no map.
    """
    if config.preset is not None and read_manifest(map_path).preset != config.preset:
        raise ConfigError(
            f"--preset {config.preset}: {map_path} was built without it; build it so, with "
            f"'placefield build --preset {config.preset}'"
        )


def min_scale_flags(text: str | None) -> dict[str, Any]:
    """Return the settings of ``--min-scale``: frames, as ``4``, or metres, as ``2.5m``.

    Raises:
        ConfigError: it is neither.
    """
    if text is None:
        return {}
    if metres := _METRES.fullmatch(text):
        return {"scales__min_scale_metres": float(metres[1])}
    if text.isdecimal():
        return {"scales__min_scale": int(text), "scales__min_scale_metres": 0}
    raise ConfigError(f"--min-scale {text!r}: write frames as 4, or metres as 2.5m")


def metres_of(flag: str, text: str) -> float:
    """Return the metres of a flag, written as ``2.5m``.

    Raises:
        ConfigError: it is not that, or is no distance.
    """
    metres = _METRES.fullmatch(text)
    if metres is None or float(metres[1]) == 0:
        raise ConfigError(f"{flag} {text!r}: write metres as 2.5m")
    return float(metres[1])


def places_or_metres(text: str | None) -> tuple[int | None, float | None]:
    """Return ``--tolerance`` in places, or in metres.

    Raises:
        ConfigError: it is neither.
    """
    if text is None:
        return None, None
    if text.isdecimal():
        return int(text), None
    if _METRES.fullmatch(text):
        return None, metres_of("--tolerance", text)
    raise ConfigError(f"--tolerance {text!r}: write places as 3, or metres as 5m")


def check_truth(
    tolerance: str | None, truth: Path | None, *, aligned: bool, same_frame: bool
) -> None:
    """Refuse two answers to what is right.

    Raises:
        ConfigError: more than one is given.
    """
    if tolerance is not None and truth is not None:
        raise ConfigError("--tolerance and --truth: give one of them")
    given = {"--truth": truth is not None, "--aligned": aligned, "--same-frame": same_frame}
    if sum(given.values()) > 1:
        raise ConfigError(
            f"{' and '.join(flag for flag in given if given[flag])}: give one of them"
        )
    if aligned and places_or_metres(tolerance)[1] is not None:
        raise ConfigError(f"--aligned: goes by places, and not by --tolerance {tolerance}")


def truth_of(
    queries: int, references: int, every: int = 1, *, tolerance: int | None, truth: Path | None
) -> Truth:
    """Return what is right, by the file or else within the tolerance.

    Args:
        queries: number of query frames.
        references: number of frames of the reference, which the file's numbers are of.
        every: every so many of these are places.
        tolerance: places; of no effect where a file is given.
        truth: the file.

    Raises:
        TruthError: the file is not the truth of so many frames.
    """
    if truth is not None:
        return read_truth(truth, queries, references).thinned(references, every)
    return Truth.within(queries, references, tolerance or 0, every)


def check_every(protocol: Protocol, every: int | None) -> None:
    """Refuse a number of frames to take one of, where the protocol takes all.

    Raises:
        ConfigError: it is of no use.
    """
    if every is not None and protocol not in TAKES_EVERY:
        raise ConfigError(
            f"--every {every}: only --protocol speed, odometry, dense and sparse take every n-th "
            "frame"
        )


def check_other(protocol: Protocol, other: str | None) -> None:
    """Check that another route's frames are given where the protocol takes any.

    Raises:
        ConfigError: they are missing, or of no use.
    """
    if protocol == "off-route" and other is None:
        raise ConfigError("--protocol off-route: give the other route's frames with --other")
    if protocol != "off-route" and other is not None:
        raise ConfigError(f"--other {other}: only --protocol off-route leaves the route")


def _setting(text: str) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    if not equals or key.lstrip().startswith("_"):
        raise ConfigError(f"--set {text!r}: write it as KEY=VALUE")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value  # a bare word
    except (ValueError, RecursionError):
        raise ConfigError(f"--set {key}: a number too long, or nested too deeply") from None
    return key.strip().replace(".", "__"), parsed
