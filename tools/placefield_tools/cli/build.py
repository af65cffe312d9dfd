"""``placefield build``: reference traverses to a map."""

from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("build")(_build)


def _build(
    references: Annotated[
        list[str],
        typer.Argument(
            metavar="REFERENCE...",
            help="folders, videos or recordings of one route, of any length and speed; or the "
            "parts of one drive",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="the map: NAME.pfmap")],
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="a map of this name that is there already")
    ] = False,
    start: options.Start = 0,
    stop: options.Stop = None,
    stride: options.Stride = 1,
    leave_out_bad: options.LeaveOutBad = False,
    one_drive: Annotated[
        bool | None,
        typer.Option(
            "--one-drive/--traverses",
            help="whether the references are parts of one drive, or traverses of one route",
            show_default="parts where one begins as another ends",
        ),
    ] = None,
    spacing: options.Spacing = None,
    topic: options.Topic = None,
    odometry_topic: options.OdometryTopic = None,
    poses: options.PoseFile = None,
    pose_axes: options.PoseAxesOption = None,
    preset: options.PresetOption = None,
    feature: options.Feature = None,
    standardise: options.Standardise = None,
    channels: options.Channels = None,
    clusters: options.Clusters = None,
    position_weight: options.PositionWeight = None,
    min_scale: options.MinScale = None,
    metric: options.Metric = None,
    seed: options.Seed = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Build a map from one or more traverses of a route.

    The places are the first traverse's frames, and --poses theirs. The others' frames are aligned
    to them, and left out where they show no place; the metric and the PCA learn from all. --start,
    --stop and --stride are of each traverse; with --leave-out-bad a frame that cannot be read in
    one of as many frames each is left out of all.

    Examples:
      placefield build day/ dusk/ -o route.pfmap
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
        **options.min_scale_flags(min_scale),
        metric__kind=metric,
        seed=seed,
    )
    check_map_path(output)
    if output.exists() and not overwrite:
        raise ConfigError(
            f"{output}: a map is there already, which services may be using; choose another name, "
            "or give --overwrite"
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
