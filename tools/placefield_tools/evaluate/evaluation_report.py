"""The figures of an evaluation, as text and as JSON."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from placefield.evaluation.reliability import Reliability
from placefield.fusion.match import FASTER
from placefield.matching.matcher import WHOLE_DRIVE
from placefield_tools.common.natural_sort import counted
from placefield_tools.evaluate.evaluation import Evaluation
from placefield_tools.evaluate.judging import Judged


def figures(evaluation: Evaluation, tolerance: int | None) -> dict[str, Any]:
    """Return the figures as one JSON object.

    The tolerance, in places, is None with a given ground truth, or with a tolerance in metres.
    Without a ground truth, only the numbers of known matches are returned.
    """
    frames = len(evaluation.descriptors)
    common = {
        "frames": frames,
        "unreadable": evaluation.unreadable,
        "missing": evaluation.missing,
        "tolerance": tolerance,
        "truth": evaluation.ground.figures(),
    }
    if evaluation.ground.truth is None:
        known = {
            rule: {"known": {"count": count, "share": count / frames}}
            for rule, count in evaluation.known.items()
        }
        return {"rules": known, **common}
    rules = {
        rule: _curve_figures(result)
        | certainty_figures(result)
        | {"lag": _lag_figures(result, evaluation.smoothed[rule])}
        for rule, result in evaluation.results.items()
    }
    if evaluation.verified is not None:
        rules["filter"]["verified"] = {
            **_curve_figures(evaluation.verified),
            **certainty_figures(evaluation.verified),
            "mean_lag": evaluation.verified.mean_lag,
        }
    return {"rules": rules, **common}


def _lag_figures(causal: Judged, smoothed: Mapping[int, Judged]) -> dict[str, dict[str, Any]]:
    """Return the figures by lag: 0, which is causal, then others, and ``all`` of the drive."""
    return {
        "all" if lag == WHOLE_DRIVE else str(lag): {
            **_curve_figures(judged),
            "expected_calibration_error": None,
            "known": None,
            "too_fast": None,
            **certainty_figures(judged),
            "mean_lag": judged.mean_lag,
        }
        for lag, judged in ({0: causal} | {**smoothed}).items()
    }


def _curve_figures(judged: Judged) -> dict[str, Any]:
    return {
        "auc": judged.curve.auc,
        "recall_at_100_precision": judged.curve.recall_at_100_precision,
        "recall_at_1": judged.curve.recall_at_1,
    }


def certainty_figures(judged: Judged) -> dict[str, Any]:
    """Return the calibration and the known matches of a method; empty without probabilities.

    The number of frames that are too fast is included. A figure without any match is None.
    """
    if judged.reliability is None or judged.claims is None:
        return {}
    known = asdict(judged.claims)
    if not judged.claims.count:
        known["precision"] = None
    return {
        "expected_calibration_error": _calibration_error(judged.reliability),
        "known": known,
        "too_fast": judged.too_fast,
    }


def headline(judged: Judged) -> str:
    """Say in one sentence what a drive comes to under a rule that says which matches are known."""
    claims, frames = judged.claims, counted(len(judged.places), "frame")
    if claims is None or judged.first_known is None:
        return f"None of {frames} known."
    wrong = claims.count - round(claims.precision * claims.count)
    verdict = f"{wrong} of them wrong" if wrong else "all right"
    first = (
        f"first known after {counted(judged.first_known, 'frame')}"
        if judged.first_known
        else "the first at once"
    )
    return f"{claims.count} of {frames} known, {verdict}; {first}."


def certainty_line(name: str, judged: Judged) -> str | None:
    """Return the figures of ``certainty_figures`` in one line of text; None if there are none."""
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
    shown = "–" if error is None else f"{error:.3f}"
    line = f"{name}: {known.count} known, {right}; expected calibration error {shown}"
    if judged.too_fast:
        line += f"; {judged.too_fast} of {counted(len(judged.places), 'frame')}: {FASTER}"
    return line


def _calibration_error(found: Reliability) -> float | None:
    return found.expected_calibration_error if found.count.any() else None


def print_table(evaluation: Evaluation, pictures: Sequence[Path]) -> None:
    """Print the figures, by what they are, and the pictures' paths."""
    if evaluation.ground.truth is None:
        _print_shares(evaluation, pictures)
        return
    console = Console(markup=False)  # a path may hold brackets
    if "filter" in evaluation.results:
        console.print(headline(evaluation.results["filter"]), highlight=False, soft_wrap=True)
    frames = counted(len(evaluation.descriptors), "frame")
    places = counted(evaluation.placemap.places.count, "place")
    table = Table(
        title=f"{evaluation.query.where}: {frames}, {places}",
        caption="recall: of all query frames that are on the route; best match per frame; "
        "mean lag: later frames that a match uses",
    )
    table.add_column("rule", no_wrap=True)
    for column in ("mean lag", "AUC", "recall at 100 % precision", "recall@1"):
        table.add_column(column, justify="right")
    for name, result in _rows(evaluation):
        curve = result.curve
        values = (curve.auc, curve.recall_at_100_precision, curve.recall_at_1)
        table.add_row(name, f"{result.mean_lag:.1f}", *(f"{value:.3f}" for value in values))
    console.print(table)
    console.print(evaluation.ground.line, highlight=False, soft_wrap=True)
    for name, result in _rows(evaluation):
        if line := certainty_line(name, result):
            console.print(line, highlight=False, soft_wrap=True)
    for picture in pictures:
        console.print(str(picture), highlight=False, soft_wrap=True)


def _print_shares(evaluation: Evaluation, pictures: Sequence[Path]) -> None:
    """Print why there is no verdict, and the fraction of frames that are known."""
    frames = len(evaluation.descriptors)
    shares = [
        f"{rule}: {count} of {counted(frames, 'frame')} known, which is {count / frames:.3f}"
        for rule, count in evaluation.known.items()
    ]
    console = Console(markup=False)
    for line in (evaluation.ground.line, *shares, *map(str, pictures)):
        console.print(line, highlight=False, soft_wrap=True)


def _rows(evaluation: Evaluation) -> Iterator[tuple[str, Judged]]:
    """Yield each rule's causal matches, and those smoothed by the lag and over the whole drive."""
    names = {evaluation.lag: f"lag {evaluation.lag}", WHOLE_DRIVE: "in hindsight"}
    for rule, causal in evaluation.results.items():
        yield rule, causal
        smoothed = evaluation.smoothed[rule]
        yield from ((f"{rule}, {names[lag]}", smoothed[lag]) for lag in names if lag in smoothed)
        if rule == "filter" and evaluation.verified is not None:
            yield f"{rule}, lag {evaluation.lag}, verified", evaluation.verified
