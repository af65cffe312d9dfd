"""``placefield evaluate``: how well a query is recognised."""

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from placefield.errors import ConfigError
from placefield.evaluation.protocols import THINS_REFERENCE, Protocol
from placefield.maps.manifest import SUFFIX
from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("evaluate")(_evaluate)


def _evaluate(
    reference: Annotated[
        str,
        typer.Argument(metavar="REF", help="a folder, video or recording, or a map: NAME.pfmap"),
    ],
    query: Annotated[str, typer.Argument(metavar="QUERY", help="a folder, video or recording")],
    tolerance: options.Tolerance = None,
    truth: options.TruthFile = None,
    aligned: options.Aligned = False,
    same_frame: options.SameFrame = False,
    protocol: options.ProtocolOption = "aligned",
    every: options.Every = None,
    other: options.Other = None,
    services: Annotated[
        bool, typer.Option("--services", help="match through the services, not in this process")
    ] = False,
    output: Annotated[Path, typer.Option("-o", "--output", help="folder for the pictures")] = Path(
        "evaluation"
    ),
    as_json: options.Json = False,
    start: options.Start = 0,
    stop: options.Stop = None,
    stride: options.Stride = 1,
    leave_out_bad: options.LeaveOutBad = False,
    spacing: options.Spacing = None,
    topic: options.Topic = None,
    odometry_topic: options.OdometryTopic = None,
    poses: options.PoseFile = None,
    pose_axes: options.PoseAxesOption = None,
    preset: options.PresetOption = None,
    feature: options.Feature = None,
    channels: options.Channels = None,
    min_scale: options.MinScale = None,
    metric: options.Metric = None,
    precision: options.Precision = None,
    seed: options.Seed = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Build a map from REF, or take one, match QUERY by every rule, and say how well it did.

    --start, --stop and --stride are of QUERY, whose frames keep their numbers; --leave-out-bad is
    of REF: a frame of QUERY that cannot be read is matched as one not seen.

    Examples:
      placefield evaluate route.pfmap dusk/ --tolerance 3
      placefield evaluate route.pfmap dusk.mcap --tolerance 5m
      placefield evaluate day/ dusk/ --protocol kidnap --seed 1
    """
    from placefield_tools.build.map_from_sources import map_of
    from placefield_tools.common.progress import CONSOLE
    from placefield_tools.evaluate.evaluation import Query, evaluate
    from placefield_tools.evaluate.evaluation_plots import draw
    from placefield_tools.evaluate.evaluation_report import figures, print_table
    from placefield_tools.evaluate.truth_source import TruthOptions
    from placefield_tools.sources import Parts

    options.check_truth(tolerance, truth, aligned=aligned, same_frame=same_frame)
    places, metres = options.places_or_metres(tolerance)
    effective = options.effective_config(
        config,
        settings,
        preset=preset,
        features__kind=feature,
        scales__channels=channels,
        **options.min_scale_flags(min_scale),
        metric__kind=metric,
        seed=seed,
        matching__precision=precision,
        matching__tolerance=places,
    )
    asked = None
    if truth is None:
        asked = TruthOptions(effective.matching.tolerance, metres, aligned, same_frame)
    within = None if truth is not None or metres is not None else effective.matching.tolerance
    options.check_other(protocol, other)
    options.check_every(protocol, every)
    _refuse_to_thin(protocol)
    if Path(reference).suffix == SUFFIX:
        options.check_preset(effective, Path(reference))
        _refuse_to_rebuild(reference, (channels, min_scale, metric, poses), settings)

    feature_asked = feature is not None
    parts_of_query = Parts(topic, odometry_topic, start=start, stop=stop, stride=stride)
    driven = Query(query, spacing, protocol, other, effective.seed, parts_of_query, every)
    parts = Parts(topic, odometry_topic, poses, pose_axes)
    with map_of(
        reference,
        effective,
        feature_asked=feature_asked,
        spacing_m=spacing,
        parts=parts,
        leave_out_bad=leave_out_bad,
    ) as map_path:
        evaluation = evaluate(
            map_path,
            driven,
            partial(options.truth_of, tolerance=effective.matching.tolerance, truth=truth),
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
            f"--protocol {protocol}: it thins the reference, and a map has all of its places; run "
            f"'placefield study REFERENCE QUERY --protocol {protocol}' on the reference's frames"
        )


def _refuse_to_rebuild(
    reference: str, flags: Sequence[object], settings: Sequence[str] | None
) -> None:
    """Refuse what says how a map is to be built, for one that is built already."""
    sections = [setting.partition(".")[0].strip() for setting in settings or ()]
    if any(flag is not None for flag in flags) or {"features", "scales", "metric"} & {*sections}:
        raise ConfigError(
            "--channels, --min-scale, --metric, --poses, and --set of features, scales or metric: "
            f"{reference} is built already; leave them out, or give the frames to build from"
        )
