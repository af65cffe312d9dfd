"""Compiled loops: what numpy can only do in many passes over memory."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Function = TypeVar("Function", bound=Callable[..., object])

_SUMS = 64  # that a compiler adds to side by side


def kernel(function: Function) -> Function:
    """Compile a function of arrays and numbers; the machine code is kept for the next process.

    Arithmetic is as written, with no liberties taken for speed: with them, bits would depend on
    what else is compiled into the same process. A division by zero gives infinity.
    """
    try:
        return cast(Function, _compiling(cache=True)(function))
    except RuntimeError:  # there is no folder that it could be kept in
        return cast(Function, _compiling(cache=False)(function))


def _compiling(*, cache: bool) -> Callable[[Callable[..., object]], object]:
    return numba.njit(cache=cache, nogil=True, error_model="numpy")


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
