"""The figures of a study, for a person and as JSON."""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from placefield_tools.evaluate.evaluation_report import certainty_figures, certainty_line
from placefield_tools.study.results import MethodResult, Study


def figures(study: Study) -> dict[str, Any]:
    """Return all figures as one JSON object."""
    return {
        "reference": study.reference,
        "query": study.query,
        "protocol": study.protocol,
        "every": study.every,
        "lowered_min_scale": study.lowered_min_scale,
        "seed": study.seed,
        "tolerance": study.tolerance,
        "truth": study.ground.figures(),
        "places": study.placemap.places.count,
        "methods": [_method_figures(result) for result in study.methods],
        "ablation": [
            {
                "rule": result.rule,
                "left_out": result.left_out,
                "lag": result.lag,
                "mean_lag": result.judged.mean_lag,
                "auc": result.judged.curve.auc,
                "recall_at_100_precision": result.judged.curve.recall_at_100_precision,
                **certainty_figures(result.judged),
            }
            for result in study.ablation
        ],
    }


def _method_figures(result: MethodResult) -> dict[str, Any]:
    named: dict[str, Any] = {
        "name": result.name,
        "ours": result.ours,
        "oracle": result.oracle,
        "lag": result.lag,
    }
    if result.judged is None:
        return named | {"failure": result.failure}
    curve = result.judged.curve
    return named | {
        "frames": curve.queries,
        "frames_on_route": curve.on_route,
        "auc": curve.auc,
        "recall_at_100_precision": curve.recall_at_100_precision,
        "recall_at_1": curve.recall_at_1,
        "auc_of_correct": curve.auc_of_correct,
        "recall_at_100_precision_of_correct": curve.recall_at_100_precision_of_correct,
        "mean_lag": result.judged.mean_lag,
        "frames_to_recover": result.frames_to_recover,
        **certainty_figures(result.judged),
    }


def print_study(study: Study, report: Path) -> None:
    """Print the methods' figures and the report's path."""
    recovers = any(result.frames_to_recover is not None for result in study.methods)
    table = Table(
        "method",
        title=f"{study.query} along {study.reference}, {_driven(study)}",
        caption="Recall is of all query frames on the route; in VPR-Bench's convention, of the "
        "right matches. Lag: how many later frames a match may use; mean lag: how many it uses. "
        "* The best window of each lag, which needs the ground truth to choose.",
    )
    headers = ["AUC", "recall at 100 % precision", "recall@1"]
    headers += ["VPR-Bench AUC", "VPR-Bench recall at 100 % precision", "mean lag"]
    headers += ["frames to recover"] if recovers else []
    for header in headers:
        table.add_column(header, justify="right")
    for result in study.methods:
        table.add_row(result.name + " *" * result.oracle, *_cells(result, recovers))
    console = Console(markup=False)  # a path may hold brackets
    console.print(table)
    console.print(study.ground.line, highlight=False, soft_wrap=True)
    for result in study.methods:
        if result.failure is not None:
            console.print(f"{result.name}: {result.failure}", highlight=False, soft_wrap=True)
        elif result.judged is not None and (line := certainty_line(result.name, result.judged)):
            console.print(line, highlight=False, soft_wrap=True)
    console.print(str(report), highlight=False, soft_wrap=True)


def _driven(study: Study) -> str:
    return study.protocol if study.every is None else f"{study.protocol}, every {study.every}"


def _cells(result: MethodResult, recovers: bool) -> list[str]:
    if result.judged is None:
        return ["failed"]
    curve = result.judged.curve
    shares = (
        curve.auc,
        curve.recall_at_100_precision,
        curve.recall_at_1,
        curve.auc_of_correct,
        curve.recall_at_100_precision_of_correct,
    )
    cells = [*(f"{share:.3f}" for share in shares), f"{result.judged.mean_lag:.1f}"]
    return [*cells, f"{result.frames_to_recover:g}"] if recovers else cells
