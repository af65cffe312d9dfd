"""The plots of an evaluation."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.features.images import decode
from placefield.matching.comparing import distance_matrix
from placefield_tools.evaluate.evaluation import Evaluation
from placefield_tools.evaluate.judging import Judged
from placefield_tools.plots import (
    MatchPair,
    plot_distance_matrix,
    plot_match_pairs,
    plot_precision_recall,
)

_MOST_CELLS = 1500  # per side of the distance matrix; more are not visible
_PAIRS = 6


def draw(folder: Path, evaluation: Evaluation, title: str) -> list[Path]:
    """Draw precision-recall curves, distance matrix and some pairs into a folder; return the files.

    The matrix and the pairs show the first rule's matches. Without a ground truth, only the matrix
    is drawn. Descriptors have no pairs of images.
    """
    folder.mkdir(parents=True, exist_ok=True)
    matrix = folder / "distances.png"
    if not evaluation.results:
        nothing = np.full(len(evaluation.descriptors), -1)
        _draw_matrix(matrix, evaluation, nothing, nothing > 0, title)
        return [matrix]
    rule, result = next(iter(evaluation.results.items()))
    curves = folder / "precision-recall.png"
    plot_precision_recall(curves, {r: x.curve for r, x in evaluation.results.items()}, title)
    _draw_matrix(matrix, evaluation, result.places, result.correct, f"{title}, {rule}")
    return [curves, matrix, *_draw_pairs(folder / "matches.png", evaluation, result)]


def _draw_matrix(
    path: Path,
    evaluation: Evaluation,
    matches: NDArray[np.int64],
    correct: NDArray[np.bool_],
    title: str,
) -> None:
    descriptors, metric = evaluation.descriptors, evaluation.placemap.channels[0].metric
    stride = -(-max(len(descriptors), len(metric.places)) // _MOST_CELLS)
    distances = distance_matrix(metric, descriptors[::stride], np.inf)[:, ::stride]
    places = np.where(matches >= 0, matches // stride, -1)
    plot_distance_matrix(
        path,
        distances,
        places[::stride],
        correct[::stride],
        title if stride == 1 else f"{title} (every {stride}th frame and place)",
    )


def _draw_pairs(path: Path, evaluation: Evaluation, result: Judged) -> list[Path]:
    if not evaluation.placemap.places.has_thumbnails:
        return []
    observed = np.array([one is not None for one in evaluation.descriptors])
    chosen = _chosen(result, observed)
    if not chosen:
        return []
    with evaluation.query.open() as source:
        wanted = set(chosen)
        shown = {number: frame for number, frame in enumerate(source) if number in wanted}
    pairs = []
    for query in chosen:
        place = int(result.places[query])
        pairs.append(
            MatchPair(
                query_image=shown[query].pixels(),
                place_image=decode(evaluation.placemap.places.thumbnail(place)),
                query=query,
                place=place,
                correct=bool(result.correct[query]),
                score=float(result.scores[query]),
                certainty=result.certainties[query] if result.certainties else None,
            )
        )
    plot_match_pairs(path, pairs)
    return [path]


def _chosen(result: Judged, observed: NDArray[np.bool_]) -> list[int]:
    """Choose query frames to show: spread evenly, and the most confident mistake."""
    answered = np.flatnonzero((result.places >= 0) & observed)
    if not len(answered):
        return []
    spread = answered[np.linspace(0, len(answered) - 1, _PAIRS).astype(int)]
    wrong = answered[~result.correct[answered]]
    worst = wrong[np.argsort(-result.scores[wrong])[:1]]
    return sorted({*spread.tolist(), *worst.tolist()})
