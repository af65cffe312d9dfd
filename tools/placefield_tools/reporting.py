"""The figures of an evaluation, for a person and as JSON."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from placefield_tools.evaluating import Evaluation


def figures(evaluation: Evaluation, tolerance: int | None) -> dict[str, Any]:
    """Return the figures as one JSON object; no tolerance where a ground truth was given."""
    rules = {
        rule: {
            "auc": result.curve.auc,
            "recall_at_100_precision": result.curve.recall_at_100_precision,
            "recall_at_1": result.curve.recall_at_1,
        }
        for rule, result in evaluation.results.items()
    }
    return {"rules": rules, "frames": len(evaluation.raws), "tolerance": tolerance}


def print_table(evaluation: Evaluation, pictures: Sequence[Path]) -> None:
    """Print the figures and the pictures' paths."""
    frames = len(evaluation.raws)
    table = Table(
        "rule",
        title=f"{evaluation.query}: {frames} frames, {evaluation.placemap.places.count} places",
        caption="recall: of all query frames that are on the route; best match per frame",
    )
    for column in ("AUC", "recall at 100 % precision", "recall@1"):
        table.add_column(column, justify="right")
    for rule, result in evaluation.results.items():
        curve = result.curve
        values = (curve.auc, curve.recall_at_100_precision, curve.recall_at_1)
        table.add_row(rule, *(f"{value:.3f}" for value in values))
    console = Console(markup=False)  # a path may hold brackets
    console.print(table)
    for picture in pictures:
        console.print(str(picture), highlight=False, soft_wrap=True)
