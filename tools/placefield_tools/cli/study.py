"""``placefield study``: every method on the same frames."""

import json
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from placefield.errors import ConfigError
from placefield.maps.manifest import SUFFIX
from placefield_tools.cli import options, options_frames, options_map, options_truth


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("study")(_study)


def _study(
    reference: Annotated[
        str, typer.Argument(metavar="REF", help="a folder, video, recording or descriptors")
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
    output: Annotated[Path, typer.Option("-o", "--output", help="folder for the report")] = Path(
        "study"
    ),
    as_json: options.Json = False,
    spacing: options_frames.Spacing = None,
    topic: options_frames.Topic = None,
    odometry_topic: options_frames.OdometryTopic = None,
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
    """Match QUERY against REF by every method and write a report.

    Placefield's own rules also run with one part left out at a time. --camera is that of REF and
    of QUERY; all methods get the rectified frames.

    With --preset paper, run the experiments of the AMS paper instead, with both of its features or
    with the one of --feature.

    Examples:
      placefield study day/ dusk/ --tolerance 3
      placefield study day/ dusk/ --protocol kidnap
      placefield study day/ dusk/ --preset paper
    """
    from placefield_tools.common.outputs import check_folder
    from placefield_tools.evaluate.query import Query
    from placefield_tools.evaluate.truth_source import TruthOptions
    from placefield_tools.sources import Parts
    from placefield_tools.study.paper.paper_report import write_paper_report
    from placefield_tools.study.paper.paper_table import paper_figures, print_paper_study
    from placefield_tools.study.paper.run_paper import run_paper_study
    from placefield_tools.study.report import write_report
    from placefield_tools.study.run_study import run_study
    from placefield_tools.study.table import figures, print_study

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
    if Path(reference).suffix == SUFFIX:
        raise ConfigError(
            f"{reference}: a map has no frames, and other methods need them; give the frames"
        )
    check_folder(output)  # a study that is cut off leaves no empty folder
    parts = Parts(topic, odometry_topic, camera=camera)
    asked_query = Query(query, spacing, protocol, other, effective.seed, parts, every, query_camera)
    truth_of = partial(options_truth.truth_of, tolerance=effective.matching.tolerance, truth=truth)
    if effective.preset == "paper":
        features = None if feature is None else (feature,)
        published = run_paper_study(
            reference, asked_query, truth_of, effective, features, tolerance=within, asked=asked
        )
        report = write_paper_report(output, published)
        if as_json:
            print(json.dumps(paper_figures(published)))
        else:
            print_paper_study(published, report)
        return
    study = run_study(reference, asked_query, truth_of, effective, tolerance=within, asked=asked)
    report = write_report(output, study)
    if as_json:
        print(json.dumps(figures(study)))
    else:
        print_study(study, report)
