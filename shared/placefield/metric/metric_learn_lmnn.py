"""LMNN by metric-learn, step by step, so that learning can stop early.

Its steps are those of ``placefield.metric.lmnn``, up to rounding. It serves to check those, and for
users who want a published library. It is 17 to 234 times slower (`placefield bench build`).
metric-learn is imported only here and in ``learners``, because it imports scikit-learn.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.metric.lmnn import (
    GROWTH,
    LmnnFit,
    first_size,
    is_negligible,
    objective,
    target_neighbours,
)

_ONE_STEP = 3  # metric-learn counts its start as the first iteration, and stops before this one


def fit_lmnn_by_metric_learn(
    descriptors: NDArray[np.float32],
    labels: NDArray[np.integer[Any]],
    *,
    neighbours: int,
    push: float,
    steps: int,
    start: NDArray[np.float32],
    on_step: Callable[[int, NDArray[np.float32]], bool],
) -> LmnnFit:
    """Minimise E by the gradient descent of metric-learn; see ``fit_lmnn`` for the arguments.

    metric-learn needs k target neighbours of every frame. So frames of labels that have no more
    than k frames are left out, also as impostors. If all labels have more, the result is that of
    ``fit_lmnn``. If fewer than two labels are left, it learns nothing.
    """
    from metric_learn import LMNN

    kept = _with_companions(labels, neighbours)
    points, own = descriptors[kept].astype(np.float64), labels[kept]
    targets = target_neighbours(points, own, neighbours)
    projection = start.astype(np.float64)
    value, gradient = objective(projection, points, own, targets, push)
    values = [value]
    size = first_size(projection, gradient)
    while len(values) <= steps and not is_negligible(size * gradient, projection):
        learner = LMNN(
            init=projection,
            n_neighbors=neighbours,
            max_iter=_ONE_STEP,
            learn_rate=size,
            regularization=1 - push,
        )
        try:
            with warnings.catch_warnings(action="ignore"):  # deprecations in scikit-learn
                stepped = learner.fit(points, own).components_
        except TypeError:  # metric-learn 0.7 raises it if there is only one label
            break
        size = GROWTH * float(np.linalg.norm(stepped - projection) / np.linalg.norm(gradient))
        value, gradient = objective(stepped, points, own, targets, push)
        if value >= values[-1]:
            break
        projection = stepped
        values.append(value)
        if on_step(len(values) - 1, projection.astype(np.float32)):
            break
    return LmnnFit(projection.astype(np.float32), np.array(values))


def _with_companions(labels: NDArray[np.integer[Any]], neighbours: int) -> NDArray[np.bool_]:
    """Return which frames are of a label with more than so many frames, (K,) bool."""
    found, counts = np.unique(labels, return_counts=True)
    return np.isin(labels, found[counts > neighbours])
