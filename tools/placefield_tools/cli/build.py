"""``placefield build``: reference traverses to a map."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from placefield.errors import ConfigError
from placefield_tools.cli import options, options_frames, options_map, options_routes


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("build")(_build)


def _build(
    references: Annotated[
        list[str],
        typer.Argument(
            metavar="REFERENCE...",
            help="folders, videos, recordings or descriptors (.npy, .npz, .h5): traverses of one "
            "route, of any length and speed; the parts of one drive; or with --routes a route each",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="the map: NAME.pfmap")],
    overwrite: options_map.Overwrite = False,
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
    routes: Annotated[
        bool,
        typer.Option("--routes", help="each reference is a route of its own, in one map"),
    ] = False,
    links: options_routes.Links = None,
    same_frame: options_routes.SameFrame = False,
    spacing: options_frames.Spacing = None,
    topic: options_frames.Topic = None,
    odometry_topic: options_frames.OdometryTopic = None,
    poses: options_frames.PoseFile = None,
    pose_axes: options_frames.PoseAxesOption = None,
    preset: options_map.PresetOption = None,
    feature: options_map.Feature = None,
    camera: options_frames.Camera = None,
    query_camera: options_map.QueryCameras = None,
    mask: options_map.MaskOption = None,
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

    With --routes, the map holds several routes, and the links between them that the frames or the
    poses show: where two routes share a stretch, or one begins where another ends. A link lets a
    vehicle pass from one route to another.

    Examples:
      placefield build day/ dusk/ -o route.pfmap
      placefield build day/ -o route.pfmap --mask auto
      placefield build day/ -o route.pfmap --camera front.yaml --query-camera phone.yaml
      placefield build reference.npy -o route.pfmap
      placefield build north/ south/ --routes -o town.pfmap
      placefield build drive.mcap --topic /camera/image_raw --odometry-topic /odom -o route.pfmap
    """
    from placefield_tools.build.map_from_sources import build_from
    from placefield_tools.build.routes_from_sources import build_routes
    from placefield_tools.build.used_part import AskedPart
    from placefield_tools.inspect.map_facts import traverse_line
    from placefield_tools.inspect.route_facts import route_lines, warn_of_unlinked
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
    parts = Parts(topic, odometry_topic, poses, pose_axes, start, stop, stride, camera)
    images = AskedPart(mask, query_camera or ())
    if routes:
        _refuse_with_routes(one_drive, poses)
        make = partial(
            build_routes,
            references,
            effective,
            parts,
            options_routes.route_options(links, same_frame=same_frame),
            spacing_m=spacing,
            leave_out_bad=leave_out_bad,
            images=images,
        )
    else:
        options_routes.refuse_without_routes(links, same_frame=same_frame)
        make = partial(
            build_from,
            references,
            effective,
            spacing_m=spacing,
            parts=parts,
            one_drive=one_drive,
            leave_out_bad=leave_out_bad,
            images=images,
        )
    built = options_map.saved_new(make, output, overwrite=overwrite)
    print(f"{output}: {built.places.count} places, {len(built.channels)} channels")
    for record in built.traverses:
        if record.aligned is not None:
            print(traverse_line(record))
    if built.model.view is not None:
        print("the map's view is {:.0f}° × {:.0f}°".format(*built.model.view.degrees))
    if built.model.mask is not None:
        print(f"the mask hides {built.model.mask.hidden:.0%} of each image")
    elif mask is not None:
        print("no part of the image stays the same along the drive: nothing is hidden")
    for line in route_lines(built):
        print(line)
    warn_of_unlinked(built)
    print(f"descriptors keep {built.model.variance_kept:.1%} of the features' variance")


def _refuse_with_routes(one_drive: bool | None, poses: Path | None) -> None:
    if one_drive is not None:
        raise ConfigError("--routes and --one-drive/--traverses: give one of them")
    if poses is not None:
        raise ConfigError("--routes: --poses is of one route; give poses in each frames.csv")
