"""Compiled loops: what numpy can only do in many passes over memory."""

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import FunctionCache
from numpy.typing import NDArray

Function = TypeVar("Function", bound=Callable[..., object])

_SUMS = 64  # that a compiler adds to side by side


class _Cache(FunctionCache):
    """Keeps machine code where there is room for it."""

    def save_overload(self, sig: object, data: object) -> None:
        """Keep what was compiled; on a full disk it is compiled again next time."""
        with suppress(OSError):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]


def kernel(function: Function) -> Function:
    """Compile a function of arrays and numbers; the machine code is kept for the next process.

    Arithmetic is as written, with no liberties taken for speed: with them, bits would depend on
    what else is compiled into the same process. A division by zero gives infinity.
    """
    compiled: Any = numba.njit(nogil=True, error_model="numpy")(function)
    with suppress(RuntimeError):  # there is no folder that it could be kept in
        compiled._cache = _Cache(function)  # type: ignore[no-untyped-call]
    return cast(Function, compiled)


@kernel
def sum_of(values: NDArray[np.floating[Any]]) -> float:
    """Sum values (n,) in float64, in interleaved sums that are added up at the end."""
    sums = np.zeros(_SUMS)
    even = len(values) - len(values) % _SUMS
    for i in range(0, even, _SUMS):
        for j in range(_SUMS):
            sums[j] += values[i + j]
    for i in range(even, len(values)):
        sums[i - even] += values[i]
    total = 0.0
    for j in range(_SUMS):
        total += sums[j]
    return total
