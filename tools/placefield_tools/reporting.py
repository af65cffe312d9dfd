"""The figures of an evaluation, for a person and as JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from placefield_tools.evaluating import Evaluation, Judged


def figures(evaluation: Evaluation, tolerance: int | None) -> dict[str, Any]:
    """Return the figures as one JSON object; no tolerance where a ground truth was given."""
    rules = {
        rule: {
            "auc": result.curve.auc,
            "recall_at_100_precision": result.curve.recall_at_100_precision,
            "recall_at_1": result.curve.recall_at_1,
        }
        | certainty_figures(result)
        for rule, result in evaluation.results.items()
    }
    return {"rules": rules, "frames": len(evaluation.raws), "tolerance": tolerance}


def certainty_figures(judged: Judged) -> dict[str, Any]:
    """Return how far a method's probabilities can be believed; nothing where it has none."""
    if judged.reliability is None or judged.claims is None:
        return {}
    return {
        "expected_calibration_error": judged.reliability.expected_calibration_error,
        "known": asdict(judged.claims),
    }


def certainty_line(name: str, judged: Judged) -> str | None:
    """Say the same in a line for a person."""
    if judged.reliability is None or judged.claims is None:
        return None
    return (
        f"{name}: {judged.claims.count} known, {judged.claims.precision:.3f} of them right; "
        f"recall of these {judged.claims.recall:.3f}; expected calibration error "
        f"{judged.reliability.expected_calibration_error:.3f}"
    )


def print_table(evaluation: Evaluation, pictures: Sequence[Path]) -> None:
    """Print the figures and the pictures' paths."""
    frames, places = len(evaluation.raws), evaluation.placemap.places.count
    table = Table(
        "rule",
        title=f"{evaluation.query.where}: {frames} frames, {places} places",
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
    for rule, result in evaluation.results.items():
        if line := certainty_line(rule, result):
            console.print(line, highlight=False, soft_wrap=True)
    for picture in pictures:
        console.print(str(picture), highlight=False, soft_wrap=True)
