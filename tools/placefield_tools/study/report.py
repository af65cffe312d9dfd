"""A study as one HTML page, to be read and printed without a network."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from placefield.config import Rule
from placefield.matching.candidate import UNANSWERED
from placefield_tools.study import figures
from placefield_tools.study.pages import write_page
from placefield_tools.study.recommendation import uses, verdict
from placefield_tools.study.results import AblationResult, LeftOut, MethodResult, Study


def write_report(folder: Path, study: Study) -> Path:
    """Write a study as `report.html`, with its pictures inside, into a folder; return the file.

    Raises:
        OSError: the folder or the file cannot be written.
    """
    return write_page(
        folder,
        "report.html.j2",
        study=study,
        title=f"{Path(study.query).name} along {Path(study.reference).name}",
        frames=_frames(study.methods),
        unanswered=[_unanswered(method) for method in study.methods],
        verdict=verdict(study),
        uses=uses(study),
        ablation=_by_part(study.ablation),
        curves=figures.precision_recall_curves(study),
        method_bars=figures.method_bars(study),
        segments=figures.segments(study),
        groups=figures.groups(study.fixed, study.placemap),
        neighbourhoods=figures.neighbourhoods(study.learned),
        calibrations=figures.calibrations(study),
    )


def _frames(methods: Sequence[MethodResult]) -> tuple[int, int] | None:
    """Return the numbers of query frames and of those on the route; None if no method ran."""
    curves = (method.judged.curve for method in methods if method.judged is not None)
    return next(((curve.queries, curve.on_route) for curve in curves), None)


def _unanswered(method: MethodResult) -> int:
    return 0 if method.judged is None else int(np.sum(method.judged.places == UNANSWERED))


def _by_part(
    ablation: Sequence[AblationResult],
) -> Mapping[LeftOut, Mapping[tuple[Rule, int], AblationResult]]:
    """Sort the results by the part that was left out, then by rule and lag."""
    parts: dict[LeftOut, dict[tuple[Rule, int], AblationResult]] = {}
    for result in ablation:
        parts.setdefault(result.left_out, {})[result.rule, result.lag] = result
    return parts
