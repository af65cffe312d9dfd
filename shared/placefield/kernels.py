"""Compiled loops: what numpy can only do in many passes over memory."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Function = TypeVar("Function", bound=Callable[..., object])


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
    """Sum values (n,) in float64, in eight interleaved sums that are added up side by side."""
    a = b = c = d = e = f = g = h = 0.0
    even = len(values) - len(values) % 8
    for i in range(0, even, 8):
        a += values[i]
        b += values[i + 1]
        c += values[i + 2]
        d += values[i + 3]
        e += values[i + 4]
        f += values[i + 5]
        g += values[i + 6]
        h += values[i + 7]
    for i in range(even, len(values)):
        a += values[i]
    return ((a + e) + (b + f)) + ((c + g) + (d + h))
