"""``placefield evaluate``: how well a query is recognised."""

import json
from pathlib import Path
from typing import Annotated

import typer

from placefield.errors import ConfigError
from placefield.evaluation.truth import Truth, read_truth
from placefield.maps.store import SUFFIX
from placefield_tools.cli import options
from placefield_tools.reporting import figures, print_table

DEFAULT_TOLERANCE = 3  # frames


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("evaluate")(_evaluate)


def _evaluate(
    reference: Annotated[
        str, typer.Argument(metavar="REF", help="a folder or video, or a map: NAME.pfmap")
    ],
    query: Annotated[str, typer.Argument(metavar="QUERY", help="a folder or video")],
    tolerance: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="query frame i is right at places i ± so many",
            show_default=str(DEFAULT_TOLERANCE),
        ),
    ] = None,
    truth: Annotated[
        Path | None, typer.Option(help="ground truth as CSV: query,first,last")
    ] = None,
    services: Annotated[
        bool, typer.Option("--services", help="match through the services, not in this process")
    ] = False,
    output: Annotated[Path, typer.Option("-o", "--output", help="folder for the pictures")] = Path(
        "evaluation"
    ),
    as_json: Annotated[bool, typer.Option("--json", help="print one JSON object")] = False,
    feature: options.Feature = None,
    channels: options.Channels = None,
    min_scale: options.MinScale = None,
    metric: options.Metric = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Build a map from REF, or take one, match QUERY by every rule, and say how well it did."""
    from placefield_tools.building import map_of
    from placefield_tools.evaluating import evaluate
    from placefield_tools.pictures import draw

    effective = options.effective_config(
        config,
        settings,
        features__kind=feature,
        scales__channels=channels,
        **options.min_scale_flags(min_scale),
        metric__kind=metric,
    )
    if truth is not None and tolerance is not None:
        raise ConfigError("--tolerance and --truth: give one of them")
    if Path(reference).suffix == SUFFIX and (channels, min_scale, metric) != (None, None, None):
        raise ConfigError(
            f"--channels, --min-scale and --metric: {reference} is built already; leave them out, "
            "or give the frames to build from"
        )
    within = None if truth is not None else DEFAULT_TOLERANCE if tolerance is None else tolerance

    def truth_of(queries: int, places: int) -> Truth:
        if truth is not None:
            return read_truth(truth, queries, places)
        return Truth.within(queries, places, within or 0)

    with map_of(reference, effective, feature_asked=feature is not None) as map_path:
        evaluation = evaluate(map_path, query, truth_of, effective, services=services)
        pictures = draw(output, evaluation, f"{Path(reference).name} → {Path(query).name}")
    if as_json:
        print(json.dumps(figures(evaluation, within)))
    else:
        print_table(evaluation, pictures)
