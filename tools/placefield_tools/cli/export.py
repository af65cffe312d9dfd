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
        Path, typer.Argument(metavar="OUT", help="where to: OUT.g2o, .tum, .geojson or .gpx")
    ],
    map_path: Annotated[
        Path, typer.Option("--map", metavar="MAP", help="the map that was matched against")
    ],
    unknown: Annotated[bool, typer.Option("--all", help="matches that are not known, too")] = False,
    stream: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="which stream, or how its name begins", show_default="the only one"
        ),
    ] = None,
    tolerance: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="a match is right within so many places: how exact a loop closure is",
            show_default=str(MatchingConfig().tolerance),
        ),
    ] = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Make recorded matches into a file for other programs.

    .g2o holds loop closures, as edges between query frames and places; .tum a trajectory, as evo
    reads it; .geojson and .gpx one on earth, of a map whose frames had latitude and longitude.

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
