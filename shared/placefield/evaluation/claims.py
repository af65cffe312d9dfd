"""How often the matches that are called known are right, and how many there are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Claims:
    """The matches that are called known.

    Attributes:
        count: how many.
        precision: share of them that is right; 1 where there is none.
        recall: right ones over query frames on the route; 0 where there is no such frame.

    """

    count: int
    precision: float
    recall: float


def claims(
    known: NDArray[np.bool_], correct: NDArray[np.bool_], on_route: NDArray[np.bool_]
) -> Claims:
    """Judge the matches that are called known; all arguments (Q,) bool."""
    count = int(np.count_nonzero(known))
    right = int(np.count_nonzero(known & correct))
    return Claims(
        count=count,
        precision=right / count if count else 1.0,
        recall=right / max(int(np.count_nonzero(on_route)), 1),
    )
