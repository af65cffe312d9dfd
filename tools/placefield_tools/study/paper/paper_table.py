"""The figures of the paper's experiments, for a person and as JSON."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from placefield_tools.evaluate.judging import Judged
from placefield_tools.study.paper import verdicts
from placefield_tools.study.paper.cost import comparisons
from placefield_tools.study.paper.paper_results import FeatureResult, PaperStudy


def paper_figures(study: PaperStudy) -> dict[str, Any]:
    """Return all figures as one JSON object."""
    return {
        "preset": "paper",
        "reference": study.reference,
        "query": study.query,
        "protocol": study.protocol,
        "every": study.every,
        "seed": study.seed,
        "tolerance": study.tolerance,
        "truth": study.ground.figures(),
        "features": [_feature_figures(result) for result in study.features],
        "others": [
            {"name": other.name, "failure": other.failure}
            if other.judged is None
            else {"name": other.name, **_judged_figures(other.judged)}
            for other in study.others
        ],
    }


def _feature_figures(result: FeatureResult) -> dict[str, Any]:
    cost, learned = result.cost, result.learned
    return {
        "feature": result.feature,
        "places": cost.places,
        "dimensions": cost.dimensions,
        "variance_kept": result.placemap.model.variance_kept,
        "push": result.placemap.metric.push,
        "smallest_scale": result.placemap.channels[0].smallest,
        "one_scale": result.one_scale,
        "lines": [
            {"method": x.method, "scales": x.scales, **_judged_figures(x.judged)}
            for x in result.lines
        ],
        "counts": [
            {
                "channels": count.channels,
                "auc": count.auc.tolist(),
                "recall_at_100_precision": count.recall.tolist(),
            }
            for count in result.counts
        ],
        "invaders": None
        if learned is None
        else {"before": learned.invaders_before, "after": learned.invaders_after},
        "cost": {
            "channels": cost.channels,
            "longest_scale": cost.longest,
            "comparisons": comparisons(cost),
            "frames_per_second": 1 / cost.seconds,
            "bytes": cost.kept_bytes,
        },
    }


def _judged_figures(judged: Judged) -> dict[str, Any]:
    return {
        "auc": judged.curve.auc,
        "recall_at_100_precision": judged.curve.recall_at_100_precision,
        "recall_at_1": judged.curve.recall_at_1,
        "mean_lag": judged.mean_lag,
    }


def print_paper_study(study: PaperStudy, report: Path) -> None:
    """Print the figures of the methods, the verdicts, and the report's path."""
    table = Table(
        "method",
        "scales",
        title=f"{study.query} along {study.reference}, {study.protocol}, as published",
        caption="Recall is of all query frames on the route. Mean lag: how many later "
        "frames a match uses.",
    )
    for header in ("AUC", "recall at 100 % precision", "recall@1", "mean lag"):
        table.add_column(header, justify="right")
    for result in study.features:
        for line in result.lines:
            table.add_row(f"{line.method}, {result.feature}", line.scales, *_cells(line.judged))
    for other in study.others:
        table.add_row(other.name, "", *(_cells(other.judged) if other.judged else ["failed"]))
    console = Console(markup=False)  # a path may hold brackets
    console.print(table)
    said = [one(result) for result in study.features for one in _VERDICTS]
    for sentence in filter(None, said):
        console.print(sentence, highlight=False, soft_wrap=True)
    for other in study.others:
        if other.failure is not None:
            console.print(f"{other.name}: {other.failure}", highlight=False, soft_wrap=True)
    console.print(str(report), highlight=False, soft_wrap=True)


_VERDICTS = (verdicts.of_methods, verdicts.of_channels)


def _cells(judged: Judged) -> list[str]:
    curve = judged.curve
    shares = (curve.auc, curve.recall_at_100_precision, curve.recall_at_1)
    return [*(f"{share:.3f}" for share in shares), f"{judged.mean_lag:.1f}"]
