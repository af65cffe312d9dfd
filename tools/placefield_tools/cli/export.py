"""``placefield export``: recorded matches for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from placefield.config import MatchingConfig
from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("export")(_export)


def _export(
    matches: Annotated[
        Path,
        typer.Argument(metavar="MATCHES", help="a recording of matches: .jsonl or .csv"),
    ],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="file to write: OUT.g2o, .tum, .geojson or .gpx")
    ],
    map_path: Annotated[Path, typer.Option("--map", metavar="MAP", help="the map of the matches")],
    unknown: Annotated[
        bool, typer.Option("--all", help="also export matches that are not known")
    ] = False,
    stream: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="name of the stream, or its first letters",
            show_default="the only stream",
        ),
    ] = None,
    tolerance: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="a match is right within so many places; sets the precision of loop closures",
            show_default=str(MatchingConfig().tolerance),
        ),
    ] = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Convert recorded matches to a file for other programs.

    .g2o has loop closures: edges between query frames and places. .tum has a trajectory for evo.
    .geojson and .gpx have a trajectory in latitude and longitude, which the frames of the map must
    have.

    Examples:
      placefield export drive.jsonl drive.tum --map route.pfmap
      placefield export drive.csv loops.g2o --map route.pfmap --all
    """
    from placefield.maps.opening import open_map
    from placefield_tools.export.export_file import check_target, export
    from placefield_tools.export.matched_traverse import localise, of_one_stream
    from placefield_tools.record.records import read_records

    effective = options.effective_config(config, settings, matching__tolerance=tolerance)
    check_target(out)
    records = of_one_stream(read_records(matches), matches, stream)
    placemap = open_map(map_path, channels=())
    tolerance = effective.matching.tolerance
    traverse = localise(records, placemap, map_path, tolerance=tolerance, unknown=unknown)
    export(traverse, out)
    print(f"{out}: {len(traverse.matches)} of {len(records)} matches")
