"""``placefield build``: reference traverses to a map."""

from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options, options_frames, options_map


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("build")(_build)


def _build(
    references: Annotated[
        list[str],
        typer.Argument(
            metavar="REFERENCE...",
            help="folders, videos, recordings or descriptors (.npy, .npz, .h5) of one route, of "
            "any length and speed; or the parts of one drive",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="the map: NAME.pfmap")],
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="replace a map of this name")
    ] = False,
    start: options_frames.Start = 0,
    stop: options_frames.Stop = None,
    stride: options_frames.Stride = 1,
    leave_out_bad: options_frames.LeaveOutBad = False,
    one_drive: Annotated[
        bool | None,
        typer.Option(
            "--one-drive/--traverses",
            help="whether the references are parts of one drive, or traverses of one route",
            show_default="parts if one begins where another ends",
        ),
    ] = None,
    spacing: options_frames.Spacing = None,
    topic: options_frames.Topic = None,
    odometry_topic: options_frames.OdometryTopic = None,
    poses: options_frames.PoseFile = None,
    pose_axes: options_frames.PoseAxesOption = None,
    preset: options_map.PresetOption = None,
    feature: options_map.Feature = None,
    standardise: options_map.Standardise = None,
    channels: options_map.Channels = None,
    clusters: options_map.Clusters = None,
    position_weight: options_map.PositionWeight = None,
    min_scale: options_map.MinScale = None,
    metric: options_map.Metric = None,
    seed: options_map.Seed = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Build a map from one or more traverses of a route.

    The places are the frames of the first traverse, and --poses are their poses. The frames of the
    other traverses are aligned to the places; a frame that shows no place is left out. The metric
    and the PCA learn from all traverses. --start, --stop and --stride apply to each traverse. With
    --leave-out-bad, a frame that cannot be read is left out; if all traverses have the same number
    of frames, it is left out of all.

    Examples:
      placefield build day/ dusk/ -o route.pfmap
      placefield build reference.npy -o route.pfmap
      placefield build drive.mcap --topic /camera/image_raw --odometry-topic /odom -o route.pfmap
    """
    from placefield.errors import ConfigError
    from placefield.maps.store import check_map_path, save_map
    from placefield_tools.build.map_from_sources import build_from
    from placefield_tools.inspect.map_facts import traverse_line
    from placefield_tools.sources import Parts

    effective = options.effective_config(
        config,
        settings,
        preset=preset,
        features__kind=feature,
        features__standardise=standardise,
        scales__channels=channels,
        scales__clusters=clusters,
        scales__position_weight=position_weight,
        **options_map.min_scale_flags(min_scale),
        metric__kind=metric,
        seed=seed,
    )
    check_map_path(output)
    if output.exists() and not overwrite:
        raise ConfigError(
            f"{output}: is there already, and services may be using it; choose another name, or "
            "give --overwrite"
        )
    parts = Parts(topic, odometry_topic, poses, pose_axes, start, stop, stride)
    built = build_from(
        references,
        effective,
        spacing_m=spacing,
        parts=parts,
        one_drive=one_drive,
        leave_out_bad=leave_out_bad,
    )
    save_map(built, output)
    print(f"{output}: {built.places.count} places, {len(built.channels)} channels")
    for record in built.traverses[1:]:
        print(traverse_line(record))
    print(f"descriptors keep {built.model.variance_kept:.1%} of the features' variance")
