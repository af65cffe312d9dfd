"""The pictures of a study, as PNG images in data URLs.

A picture for which the study has no results is None.
"""

from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from placefield.evaluation.claims import Claims
from placefield_tools.inspect.map_summary import draw_segments
from placefield_tools.plots import (
    AucBar,
    plot_auc_bars,
    plot_precision_recall_panels,
    plot_reliability,
)
from placefield_tools.study.results import MethodResult, Study


@dataclass(frozen=True)
class Calibration:
    """How reliable a method's probabilities are.

    Attributes:
        method: its name.
        error: expected calibration error.
        diagram: reliability diagram, a data URL.
        claims: its matches that are known.
    """

    method: str
    error: float
    diagram: str
    claims: Claims | None


def precision_recall_curves(study: Study) -> str | None:
    """Draw the curve of every method that did not fail."""
    curves = {_name(m): m.judged.curve for m in study.methods if m.judged is not None}
    if not curves:
        return None
    ours = [_name(method) for method in study.methods if method.ours]
    return data_url(lambda path: plot_precision_recall_panels(path, curves, ours))


def method_bars(study: Study) -> str | None:
    """Draw AUC and recall of every method."""
    bars = [_bar(method) for method in study.methods]
    return data_url(lambda path: plot_auc_bars(path, bars)) if bars else None


def segments(study: Study) -> str:
    """Draw the segments and scales of the map's channels."""
    return data_url(lambda path: draw_segments(study.placemap, path))


def calibrations(study: Study) -> list[Calibration]:
    """Draw the reliability of every method that gives probabilities, over its answers."""
    found = []
    for method in study.methods:
        judged = method.judged
        if judged is None or judged.reliability is None:
            continue
        diagram = data_url(partial(plot_reliability, found=judged.reliability))
        error = judged.reliability.expected_calibration_error
        found.append(Calibration(method.name, error, diagram, judged.claims))
    return found


def _name(method: MethodResult) -> str:
    return f"{method.name} (oracle)" if method.oracle else method.name


def _bar(method: MethodResult) -> AucBar:
    if method.judged is None:
        return AucBar(method.name, auc=None, recall=None, ours=method.ours)
    curve = method.judged.curve
    return AucBar(_name(method), curve.auc, curve.recall_at_100_precision, method.ours)


def data_url(draw: Callable[[Path], None]) -> str:
    """Return a picture that is drawn into a file, as PNG in a data URL."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "picture.png")
        draw(path)
        return f"data:image/png;base64,{b64encode(path.read_bytes()).decode('ascii')}"
