"""Options about building a map and matching on it."""

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import typer

from placefield.config import Config, Rule
from placefield.errors import ConfigError
from placefield.maps.manifest import check_map_path, read_manifest
from placefield.presets import Preset
from placefield_tools.cli.options import METRES
from placefield_tools.common.outputs import make_folder

if TYPE_CHECKING:
    from placefield.maps.map import Map

_DEFAULTS = Config()


def _feature_named(kind: str | None) -> str | None:
    """Turn the name of a fetched network into its file; most commands need not import this."""
    if kind is None:
        return None
    from placefield_tools.models.getting import feature_named

    return feature_named(kind)


PresetOption = Annotated[
    Preset | None,
    typer.Option(
        "--preset",
        help="sets many settings at once; paper: AMS as published; see 'placefield config'",
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
        help="compare with every place exactly, even if the map has a coarse search",
        show_default=False,
    ),
]
Precision = Annotated[
    float | None,
    typer.Option(
        metavar="P",
        help="a match is known if it is right with at least this probability",
        show_default=f"{_DEFAULTS.matching.precision:g}",
    ),
]
Feature = Annotated[
    str | None,
    typer.Option(
        metavar="KIND",
        help="grayscale, gist, onnx:FILE for a network, or its name if it was fetched by "
        "'placefield models get'; several as gist+NAME; descriptors need none",
        callback=_feature_named,
        show_default=_DEFAULTS.features.kind,
    ),
]
MaskOption = Annotated[
    str | None,
    typer.Option(
        metavar="IMAGE or auto",
        help="an image of the frames' aspect ratio whose black part is not used, as a bonnet; "
        "auto: what never changes along the first traverse; with --camera, of rectified frames",
        show_default="all is used",
    ),
]
QueryCameras = Annotated[
    list[Path] | None,
    typer.Option(
        "--query-camera",
        metavar="FILE",
        help="calibration of another camera that will drive the route: the map uses only what it "
        "and --camera both see; may be given several times",
        show_default=False,
    ),
]
Standardise = Annotated[
    bool | None,
    typer.Option(
        "--standardise/--no-standardise",
        help="subtract the query's running mean and divide by its running deviation",
        show_default="standardise" if _DEFAULTS.features.standardise else "no-standardise",
    ),
]
Channels = Annotated[
    int | None,
    typer.Option(help="number of channels", show_default=str(_DEFAULTS.scales.channels)),
]
Clusters = Annotated[
    int | None, typer.Option(help="clusters per channel", show_default="estimated")
]
PositionWeight = Annotated[
    float | None,
    typer.Option(
        help="weight of the position in the route when clustering; 0: the paper",
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
        help="lmnn, rca, lfda, nca or identity; a learned metric is kept only if it helps",
        show_default=_DEFAULTS.metric.kind,
    ),
]
Seed = Annotated[
    int | None, typer.Option(help="seed of all random numbers", show_default=str(_DEFAULTS.seed))
]


Overwrite = Annotated[bool, typer.Option("--overwrite", help="replace a map of this name")]
ChangedMap = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        help="another map for the result, which leaves MAP as it is",
        show_default="MAP",
    ),
]


class MakesMap(Protocol):
    """Makes a map."""

    def __call__(self, *, kept_in: Path) -> "Map":
        """Make it; a folder is for finished steps, see ``Steps``."""


def saved_new(make: MakesMap, path: Path, *, overwrite: bool) -> "Map":
    """Make a map and save it at a path for a new map, which is refused before the work.

    Until it is saved, no other process can change the map that it replaces. Finished steps are kept
    in ``NAME.pfmap.building``, which is removed once the map is saved.

    Raises:
        ConfigError: see ``_check_new_map``.
        MapError: another process is changing the map at the path; or see ``save_map``.
        PlacefieldError: whatever ``make`` raises.
    """
    from placefield.maps.map_lock import replacing
    from placefield.maps.store import save_map

    _check_new_map(path, overwrite=overwrite)
    with replacing(path):
        kept_in = path.with_name(f"{path.name}.building")
        made = make(kept_in=kept_in)
        _check_new_map(path, overwrite=overwrite)  # another process may have made one meanwhile
        save_map(made, path)
        shutil.rmtree(kept_in, ignore_errors=True)
    return made


def _check_new_map(path: Path, *, overwrite: bool) -> None:
    """Refuse a path for a new map where there is one, unless it may be replaced; make its folder.

    Raises:
        ConfigError: the path is taken, or its folder cannot be made.
        MapError: the path is no map's, see ``check_map_path``.
    """
    check_map_path(path)
    if path.exists() and not overwrite:
        raise ConfigError(
            f"{path}: is there already, and services may be using it; choose another name, or "
            "give --overwrite"
        )
    make_folder(path.parent)


def changed_map(map_path: Path, output: Path | None) -> Path:
    """Return where a changed map is written to: the map's own path, or a new one in its folder.

    Raises:
        ConfigError: the other path is taken, or its folder cannot be made.
        MapError: the other path is no map's, see ``check_map_path``.
    """
    if output is None:
        return map_path
    check_map_path(output)
    if output.exists():
        raise ConfigError(f"{output}: is there already; choose another name, or leave out --output")
    make_folder(output.parent)
    return output


def check_preset(config: Config, map_path: Path) -> None:
    """Refuse a map that was built without the preset in force.

    A preset also sets how a map is built, so that matching alone cannot follow it.

    Raises:
        ConfigError: the map was built without the preset.
        MapError: there is no map at the path.
    """
    if config.preset is not None and read_manifest(map_path).preset != config.preset:
        raise ConfigError(
            f"--preset {config.preset}: {map_path} was built without it; build the map with "
            f"'placefield build --preset {config.preset}'"
        )


def min_scale_flags(text: str | None) -> dict[str, Any]:
    """Return the settings of ``--min-scale``: frames like ``4``, or metres like ``2.5m``.

    Raises:
        ConfigError: the text has another form.
    """
    if text is None:
        return {}
    if metres := METRES.fullmatch(text):
        return {"scales__min_scale_metres": float(metres[1])}
    if text.isdecimal():
        return {"scales__min_scale": int(text), "scales__min_scale_metres": 0}
    raise ConfigError(f"--min-scale {text!r}: write frames as 4, or metres as 2.5m")
