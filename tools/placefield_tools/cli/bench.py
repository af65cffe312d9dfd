"""``placefield bench``: speed of Placefield beside other implementations, in one run."""

import json
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from placefield.errors import ConfigError
from placefield_tools.cli import options, options_map

if TYPE_CHECKING:
    from placefield_tools.bench.figure import Figure

_MODULES = {
    "match": "match_speed",
    "features": "features",
    "build": "build_cost",
    "chain": "chain",
    "scale": "scale",
    "explore": "exploring",
    "soak": "soak",
}
"""The module of ``placefield_tools.bench`` behind each command."""

_app = typer.Typer(
    help="Measure speed as ratios, in one run, and compare with the targets. Ways take turns until "
    "the 95 % interval of their ratio is narrower than 10 % of it, or the time is over; then it is "
    "called wide. The last figures say how busy and how fast the machine was.",
    no_args_is_help=True,
)


def add_to(app: typer.Typer) -> None:
    """Add the commands."""
    app.add_typer(_app, name="bench")


@_app.command("match")
def _match(as_json: options.Json = False) -> None:
    """Matching: compare with the bare equations, and with distances alone."""
    _measure("match", as_json)


@_app.command("features")
def _features(feature: options_map.Feature = None, as_json: options.Json = False) -> None:
    """Descriptors: compare GIST with a naive one, with its limit, and with decoding alone.

    With --feature, only JPEGs to descriptors of that feature, compared with decoding alone.
    """
    if feature is None:
        _measure("features", as_json)
    else:
        kind = options.effective_config(None, None, features__kind=feature).features.kind
        _measure("features", as_json, feature=kind)


@_app.command("build")
def _build(
    places: Annotated[
        int | None,
        typer.Option(min=2000, help="measure only the build of so many described places"),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Building maps: compare with metric-learn's LMNN; time and memory of the command.

    With --places, only a build from descriptors; 1000000 take a quarter of an hour and more.
    """
    if places is None:
        _measure("build", as_json)
    else:
        _measure("build", as_json, places=places)


@_app.command("chain")
def _chain(as_json: options.Json = False) -> None:
    """All services: compare with processes that do no work; then with 16 cameras."""
    _measure("chain", as_json)


@_app.command("scale")
def _scale(
    places: Annotated[
        int | None,
        typer.Option(
            min=1000,
            max=10_000_000,
            help="measure only a map of so many places, with one metric; for 10000000 it takes an "
            "hour, and 20 GB in the temporary folder",
        ),
    ] = None,
    as_json: options.Json = False,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="draw time and memory by map size into this PNG"),
    ] = None,
) -> None:
    """Maps of a thousand to ten million places: time of a frame, and memory."""
    from placefield_tools.common.outputs import check_folder_of

    if picture is not None and places is not None:
        raise ConfigError("--picture: it shows maps of all sizes; leave out --places")
    if picture is not None:
        check_folder_of(picture)
    figures = _measure("scale", as_json, places=places)
    if picture is not None:
        from placefield_tools.bench.figure import as_object
        from placefield_tools.bench.scale import SIZES
        from placefield_tools.bench.scale_picture import draw_scale

        draw_scale(picture, as_object(figures), SIZES)


@_app.command("explore")
def _explore(
    frames: Annotated[
        int,
        typer.Option(min=2000, help="number of frames, each a new place; 100000 take an hour"),
    ] = 10_000,
    as_json: options.Json = False,
) -> None:
    """Exploring without a map: time of a frame, and memory of a place."""
    _measure("explore", as_json, frames=frames)


@_app.command("soak")
def _soak(
    frames: Annotated[
        int,
        typer.Option(
            min=1,
            help="number of frames; default: a day at 12 per second, which takes an hour",
        ),
    ] = 1_000_000,
    as_json: options.Json = False,
) -> None:
    """A day of frames in one stream: whether memory grows, and whether answers stay the same."""
    _measure("soak", as_json, frames=frames)


def _measure(part: str, as_json: bool, **how: int | str | None) -> "Sequence[Figure]":
    try:
        module = import_module(f"placefield_tools.bench.{_MODULES[part]}")
        from placefield_tools.bench.figure import as_object, print_figures
        from placefield_tools.bench.machine import with_machine
    except ModuleNotFoundError as missing:
        raise ConfigError(
            f"bench {part} needs {missing.name}: pip install 'placefield[bench]'"
        ) from None
    figures = with_machine(partial(getattr(module, f"bench_{part}"), **how))
    if as_json:
        print(json.dumps(as_object(figures)))
    else:
        print_figures(f"placefield bench {part}", figures)
    return figures
