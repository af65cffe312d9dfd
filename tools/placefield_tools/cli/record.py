"""``placefield record``: matches into a file."""

import logging
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options

log = logging.getLogger(__name__)


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("record")(_record)


def _record(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="file to write: FILE.jsonl, .csv, .mcap or .rrd"),
    ],
    frames: Annotated[
        bool,
        typer.Option("--frames", help="also record small query frames, in .mcap or .rrd"),
    ] = False,
    map_path: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="MAP",
            help="map of the run: adds latitude and longitude, if it was built from frames with "
            "GPS, and with --frames the images of the places, in .mcap or .rrd",
            show_default=False,
        ),
    ] = None,
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Record the matches and smoothed matches of a run until Ctrl-C.

    .jsonl has the output of 'placefield listen --json', .csv has a row per match. Both are written
    line by line, so that a killed recorder loses no line, and 'placefield export' reads them. .mcap
    opens in Foxglove and .rrd in Rerun, at the stamps of the frames. A .rrd has its layout in it,
    and draws matching.precision of these settings beside the probabilities. With --map, matches of
    another map are left out, but not those of a new version that replaces MAP.

    Examples:
      placefield record drive.jsonl
      placefield record drive.mcap --frames --map route.pfmap
    """
    from placefield.maps.geography import Origin
    from placefield.maps.version_digests import VersionDigests
    from placefield_services.process import stop_event
    from placefield_tools.record.georeference import origin_of
    from placefield_tools.record.place_pictures import PlacePictures, with_places
    from placefield_tools.record.record_run import record
    from placefield_tools.record.recorder_files import recorder_of

    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, bus__credentials=credentials
    )
    origin = versions = None
    if map_path:
        versions = VersionDigests(map_path)
        pose_frame = versions.manifest.pose_frame
        origin = Origin.of_frame(pose_frame)
        if origin is None and not frames:
            origin = origin_of(pose_frame, map_path, "add --frames, or leave --map out")
    into = recorder_of(file, origin=origin, frames=frames, precision=effective.matching.precision)
    if map_path and frames:
        into = with_places(into, PlacePictures(map_path))
    counts = record(
        effective,
        into,
        stop_event(),
        frames=frames,
        digests=versions,
        ready=lambda: print(f"recording run {effective.run!r} into {file}", flush=True),
    )
    _report(file, counts, frames=frames)


def _report(file: Path, counts: Counter[str], *, frames: bool) -> None:
    written = [f"{counts.pop('matches', 0)} matches"]
    written.append(f"{counts.pop('smoothed matches', 0)} smoothed")
    if verified := counts.pop("verified matches", 0):
        written.append(f"{verified} verified")
    if frames:
        written.append(f"{counts.pop('frames', 0)} frames")
    print(f"{file}: {', '.join(written)}")
    if counts:
        missing = ", ".join(f"{count} {what}" for what, count in counts.items())
        log.warning("not in %s: %s", file, missing)
