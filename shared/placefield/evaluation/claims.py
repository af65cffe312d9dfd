"""The number, the precision and the recall of the known matches."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Claims:
    """Statistics of the known matches.

    Attributes:
        count: number of known matches.
        precision: fraction of them that are right; 1 if there are none.
        recall: right ones over query frames on the route; 0 if no frame is on the route.
    """

    count: int
    precision: float
    recall: float


def claims(
    known: NDArray[np.bool_], correct: NDArray[np.bool_], on_route: NDArray[np.bool_]
) -> Claims:
    """Judge the known matches; all arguments are (Q,) bool."""
    count = int(np.count_nonzero(known))
    right = int(np.count_nonzero(known & correct))
    return Claims(
        count=count,
        precision=right / count if count else 1.0,
        recall=right / max(int(np.count_nonzero(on_route)), 1),
    )
