"""``placefield evaluate``: the accuracy of a query."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from placefield.errors import ConfigError
from placefield.evaluation.protocols import THINS_REFERENCE, Protocol
from placefield.maps.manifest import SUFFIX
from placefield_tools.cli import options, options_frames, options_map, options_truth


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("evaluate")(_evaluate)


def _evaluate(
    reference: Annotated[
        str,
        typer.Argument(
            metavar="REF", help="a folder, video, recording, descriptors, or a map: NAME.pfmap"
        ),
    ],
    query: Annotated[
        str, typer.Argument(metavar="QUERY", help="a folder, video, recording or descriptors")
    ],
    tolerance: options_truth.Tolerance = None,
    truth: options_truth.TruthFile = None,
    aligned: options_truth.Aligned = False,
    same_frame: options_truth.SameFrame = False,
    protocol: options_truth.ProtocolOption = "aligned",
    every: options_truth.Every = None,
    other: options_truth.Other = None,
    services: Annotated[
        bool, typer.Option("--services", help="match through the services, not in this process")
    ] = False,
    output: Annotated[Path, typer.Option("-o", "--output", help="folder for the plots")] = Path(
        "evaluation"
    ),
    as_json: options.Json = False,
    start: options_frames.Start = 0,
    stop: options_frames.Stop = None,
    stride: options_frames.Stride = 1,
    leave_out_bad: options_frames.LeaveOutBad = False,
    spacing: options_frames.Spacing = None,
    topic: options_frames.Topic = None,
    odometry_topic: options_frames.OdometryTopic = None,
    poses: options_frames.PoseFile = None,
    pose_axes: options_frames.PoseAxesOption = None,
    camera: options_frames.Camera = None,
    query_camera: options_frames.QueryCamera = None,
    preset: options_map.PresetOption = None,
    feature: options_map.Feature = None,
    channels: options_map.Channels = None,
    min_scale: options_map.MinScale = None,
    metric: options_map.Metric = None,
    precision: options_map.Precision = None,
    seed: options_map.Seed = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Match QUERY against REF by every rule, and report the accuracy. REF is a map, or frames.

    --start, --stop and --stride choose frames of QUERY; the frames keep their numbers. --camera is
    that of QUERY, and of REF if that is frames. --leave-out-bad is about REF. An unreadable frame
    of QUERY is a missing observation.

    Examples:
      placefield evaluate route.pfmap dusk/ --tolerance 3
      placefield evaluate route.pfmap dusk.mcap --tolerance 5m
      placefield evaluate day/ dusk/ --protocol kidnap --seed 1
    """
    from placefield_tools.build.map_from_sources import map_of
    from placefield_tools.build.used_part import AskedPart
    from placefield_tools.common.outputs import check_folder
    from placefield_tools.common.progress import CONSOLE
    from placefield_tools.evaluate.evaluation import evaluate
    from placefield_tools.evaluate.evaluation_plots import draw
    from placefield_tools.evaluate.evaluation_report import figures, print_table
    from placefield_tools.evaluate.query import Query
    from placefield_tools.evaluate.truth_source import TruthOptions
    from placefield_tools.sources import Parts

    options_truth.check_truth(tolerance, truth, aligned=aligned, same_frame=same_frame)
    places, metres = options_truth.places_or_metres(tolerance)
    effective = options.effective_config(
        config,
        settings,
        preset=preset,
        features__kind=feature,
        scales__channels=channels,
        **options_map.min_scale_flags(min_scale),
        metric__kind=metric,
        seed=seed,
        matching__precision=precision,
        matching__tolerance=places,
    )
    asked = None
    if truth is None:
        asked = TruthOptions(effective.matching.tolerance, metres, aligned, same_frame)
    within = None if truth is not None or metres is not None else effective.matching.tolerance
    options_truth.check_other(protocol, other)
    options_truth.check_every(protocol, every)
    _refuse_to_thin(protocol)
    check_folder(output)
    if Path(reference).suffix == SUFFIX:
        options_map.check_preset(effective, Path(reference))
        _refuse_to_rebuild(reference, (channels, min_scale, metric, poses), settings)
        if query_camera is not None:
            raise ConfigError(
                f"--query-camera {query_camera}: {reference} is built already; give the camera of "
                "QUERY as --camera"
            )

    feature_asked = feature is not None
    parts_of_query = Parts(
        topic, odometry_topic, start=start, stop=stop, stride=stride, camera=camera
    )
    asked_query = Query(
        query, spacing, protocol, other, effective.seed, parts_of_query, every, query_camera
    )
    parts = Parts(topic, odometry_topic, poses, pose_axes, camera=camera)
    with map_of(
        reference,
        effective,
        feature_asked=feature_asked,
        spacing_m=spacing,
        parts=parts,
        leave_out_bad=leave_out_bad,
        images=AskedPart(query_cameras=asked_query.other_cameras),
    ) as map_path:
        right_within = effective.matching.tolerance
        near = options_truth.places_near_in(map_path, right_within)
        evaluation = evaluate(
            map_path,
            asked_query,
            partial(options_truth.truth_of, tolerance=right_within, truth=truth, near=near),
            effective,
            services=services,
            asked=asked,
        )
        pictures = draw(output, evaluation, f"{Path(reference).name} → {Path(query).name}")
    if as_json:
        if evaluation.ground.truth is None:
            CONSOLE.print(evaluation.ground.line, soft_wrap=True)
        print(json.dumps(figures(evaluation, within)))
    else:
        print_table(evaluation, pictures)


def _refuse_to_thin(protocol: Protocol) -> None:
    if protocol in THINS_REFERENCE:
        raise ConfigError(
            f"--protocol {protocol}: it thins the reference, and a map cannot be thinned; run "
            f"'placefield study REFERENCE QUERY --protocol {protocol}' on the reference's frames"
        )


def _refuse_to_rebuild(
    reference: str, flags: Sequence[object], settings: Sequence[str] | None
) -> None:
    """Refuse options about building a map if the map exists already."""
    sections = [setting.partition(".")[0].strip() for setting in settings or ()]
    if any(flag is not None for flag in flags) or {"features", "scales", "metric", "build"} & {
        *sections
    }:
        raise ConfigError(
            "--channels, --min-scale, --metric, --poses, and --set of features, scales, metric or "
            f"build: {reference} is built already; leave them out, or give the frames instead"
        )
