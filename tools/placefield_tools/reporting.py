"""The figures of an evaluation, for a person and as JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from placefield.evaluation.reliability import Reliability
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
    """Return how far a method's probabilities can be believed; nothing where it has none.

    A figure over no match at all is None.
    """
    if judged.reliability is None or judged.claims is None:
        return {}
    known = asdict(judged.claims)
    if not judged.claims.count:
        known["precision"] = None
    return {"expected_calibration_error": _calibration_error(judged.reliability), "known": known}


def certainty_line(name: str, judged: Judged) -> str | None:
    """Say the same in a line for a person."""
    if judged.reliability is None or judged.claims is None:
        return None
    known = judged.claims
    right = (
        f"{known.precision:.3f} of them right, which is {known.recall:.3f} of the frames on the "
        "route"
        if known.count
        else "– of them right"
    )
    error = _calibration_error(judged.reliability)
    told = "–" if error is None else f"{error:.3f}"
    return f"{name}: {known.count} known, {right}; expected calibration error {told}"


def _calibration_error(found: Reliability) -> float | None:
    return found.expected_calibration_error if found.count.any() else None


def print_table(evaluation: Evaluation, pictures: Sequence[Path]) -> None:
    """Print the figures and the pictures' paths."""
    frames = _counted(len(evaluation.raws), "frame")
    places = _counted(evaluation.placemap.places.count, "place")
    table = Table(
        "rule",
        title=f"{evaluation.query.where}: {frames}, {places}",
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


def _counted(count: int, name: str) -> str:
    return f"{count} {name}" if count == 1 else f"{count} {name}s"
