"""``placefield loops``: the loops of one drive, without a map."""

import json
from pathlib import Path
from typing import Annotated

import typer

from placefield.config import MatchingConfig
from placefield_tools.cli import options, options_frames, options_map


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("loops")(_loops)


def _loops(
    drive: Annotated[
        list[str],
        typer.Argument(
            metavar="DRIVE...",
            help="a folder, video, recording or descriptors, or the parts of one drive",
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="file to write: NAME.g2o, .csv or .json")
    ],
    tolerance: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="an answer is right within so many places",
            show_default=str(MatchingConfig().tolerance),
        ),
    ] = None,
    precision: options_map.Precision = None,
    as_json: options.Json = False,
    start: options_frames.Start = 0,
    stop: options_frames.Stop = None,
    stride: options_frames.Stride = 1,
    spacing: options_frames.Spacing = None,
    topic: options_frames.Topic = None,
    odometry_topic: options_frames.OdometryTopic = None,
    poses: options_frames.PoseFile = None,
    pose_axes: options_frames.PoseAxesOption = None,
    camera: options_frames.Camera = None,
    feature: options_map.Feature = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Find where DRIVE comes back to a place, without a map.

    Each frame is matched with the earlier places of the same drive, except the last ones, which
    look alike. .csv and .json have a row for each frame: its most likely earlier place, the
    probability, and the probability that the place is new. .g2o is a pose graph with an edge for
    each loop.

    Examples:
      placefield loops drive/ -o loops.csv
      placefield loops drive.mcap --odometry-topic /odom -o loops.g2o
    """
    from placefield_tools.loops.finding import find_loops
    from placefield_tools.loops.loop_files import check_output, write_loops
    from placefield_tools.sources import Parts, open_source
    from placefield_tools.sources.secrets import without_secrets
    from placefield_tools.sources.source_factory import name_of

    effective = options.effective_config(
        config,
        settings,
        features__kind=feature,
        matching__tolerance=tolerance,
        matching__precision=precision,
    )
    check_output(output)
    parts = Parts(topic, odometry_topic, poses, pose_axes, start, stop, stride, camera)
    source = open_source(drive, spacing_m=spacing, parts=parts)
    loops = find_loops(source, without_secrets(name_of(drive)), effective)
    write_loops(loops, output)
    causal = sum(answer.known for answer in loops.causal)
    if as_json:
        figures = {
            "frames": len(loops.frames),
            "in_loops": causal,
            "in_loops_smoothed": loops.count(),
        }
        print(json.dumps(figures))
    else:
        print(
            f"{output}: {loops.count()} of {len(loops.frames)} frames show an earlier place "
            f"({causal} without later frames)"
        )
