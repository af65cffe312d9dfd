"""The pictures of a study, as WebP images in data URLs.

A picture for which the study has no results is None.
"""

from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.evaluation.claims import Claims
from placefield.maps.map import Map
from placefield_tools.inspect.map_summary import draw_segments, segments_of
from placefield_tools.plots import (
    AucBar,
    plot_auc_bars,
    plot_groups,
    plot_neighbourhood,
    plot_precision_recall_panels,
    plot_reliability,
)
from placefield_tools.plots.frame_pictures import PictureOf
from placefield_tools.study.neighbours import Learned
from placefield_tools.study.results import MethodResult, Study

_GROUPED = 24  # frames of the stretch that is shown in groups
_LOSSLESS, _PHOTOGRAPHS = 101, 80  # OpenCV's quality of WebP; above 100 no pixel changes


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


def groups(fixed: Map | None, adaptive: Map) -> str | None:
    """Draw how fixed and adaptive segments group the frames in the middle of the route.

    Descriptors have no frames to draw.

    Args:
        fixed: a map whose segments have fixed lengths; None where there is none.
        adaptive: a map of the same places, whose segments are clusters.
    """
    if fixed is None or not adaptive.places.has_thumbnails:
        return None
    rows = {
        f"Fixed segments (MS), {fixed.channels[0].scales[0]} frames each": segments_of(fixed)[0],
        "Adaptive segments, channel 0": segments_of(adaptive)[0],
    }
    count = min(_GROUPED, adaptive.places.count)
    first = (adaptive.places.count - count) // 2
    picture_of = pictures_of(adaptive)
    return data_url(
        lambda path: plot_groups(path, rows, first, picture_of, count), photographs=True
    )


def neighbourhoods(learned: Learned | None) -> str | None:
    """Draw a frame's neighbours before and after learning."""
    if learned is None:
        return None
    return data_url(lambda path: plot_neighbourhood(path, learned.before, learned.after))


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


def pictures_of(placemap: Map) -> PictureOf:
    """Return what gives the frame of each place of a map that has thumbnails."""

    def picture_of(place: int) -> NDArray[np.uint8]:
        encoded = np.frombuffer(placemap.places.thumbnail(place), np.uint8)
        return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR), np.uint8)

    return picture_of


def data_url(draw: Callable[[Path], None], *, photographs: bool = False) -> str:
    """Return a picture that is drawn into a PNG file, as WebP in a data URL.

    It has the same pixels; with ``photographs`` nearly so, and then it is much smaller.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder, "picture.png")
        draw(path)
        picture = np.asarray(cv2.imread(str(path), cv2.IMREAD_COLOR), np.uint8)
    quality = _PHOTOGRAPHS if photographs else _LOSSLESS
    _, encoded = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, quality])
    return f"data:image/webp;base64,{b64encode(encoded.tobytes()).decode('ascii')}"
