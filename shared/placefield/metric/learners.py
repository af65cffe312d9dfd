"""Metrics of the package metric-learn: RCA, LFDA and NCA.

RCA (Shental et al., ECCV 2002) whitens by the covariance within segments; LFDA (Sugiyama, JMLR
2007) maximises the scatter between segments over that within; NCA (Goldberger et al., NIPS 2004)
maximises the probability that a frame's random neighbour is of its segment.

metric-learn is imported only when one of them is used, because it imports scikit-learn, which takes
a second.
"""

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.config import MetricConfig

Array = NDArray[np.float32]
Labels = NDArray[np.integer[Any]]

_FRAMES_PER_DIMENSION = 4
"""With 2, the covariances were too uncertain: recall of real queries was lower."""


class NothingLearnedError(Exception):
    """No metric can be learned from these frames; says why. The identity replaces it."""


def fit_reference_learner(points: Array, labels: Labels, config: MetricConfig, seed: int) -> Array:
    """Learn a projection by metric-learn, as (N, N) float32.

    points is (K, N), principal components in order, labels (K,), 0 where a frame is inactive.
    Inactive frames and segments of one frame are ignored. Only the first dimensions are learned,
    one for every 4 frames, and the projection drops the others, because covariances within segments
    of fewer frames are singular or nearly so.

    config has the kind of learner, LFDA's neighbours and NCA's most steps. NCA holds the (K, K)
    distances of its training frames.

    Raises:
        NothingLearnedError: fewer than two segments or too few frames are left, or their
            covariances are singular.
    """
    teaching, segments = _teaching(labels)
    dimensions = min(np.count_nonzero(teaching) // _FRAMES_PER_DIMENSION, points.shape[1])
    if segments < 2:
        raise NothingLearnedError("fewer than two segments have two frames to learn from")
    if dimensions < 2:
        raise NothingLearnedError("the segments have too few frames to learn from")
    leading = points[teaching, :dimensions].astype(np.float64)
    learned = _fit(leading, labels[teaching], config, seed)
    if not (np.isrealobj(learned) and np.isfinite(learned).all() and learned.any()):
        raise NothingLearnedError("the segments' covariances are singular")
    projection = np.zeros((points.shape[1], points.shape[1]), np.float32)
    projection[:dimensions, :dimensions] = learned
    return projection


def _teaching(labels: Labels) -> tuple[NDArray[np.bool_], int]:
    """Return which frames are of active segments of at least two frames, and how many those are."""
    segments, counts = np.unique(labels[labels > 0], return_counts=True)
    kept = segments[counts >= 2]
    return np.isin(labels, kept), len(kept)


def _fit(points: NDArray[np.float64], labels: Labels, config: MetricConfig, seed: int) -> Any:
    from metric_learn import LFDA, NCA, RCA

    learner = {
        "rca": RCA(),
        "lfda": LFDA(k=min(config.neighbours, points.shape[1] - 1)),
        "nca": NCA(init="identity", max_iter=config.steps, random_state=seed % 2**32),
    }[config.kind]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        # RCA only warns of a singular covariance.
        warnings.simplefilter("error", UserWarning)
        try:
            return learner.fit(points, labels).components_
        except (UserWarning, ValueError, np.linalg.LinAlgError):
            raise NothingLearnedError("the segments' covariances are singular") from None
