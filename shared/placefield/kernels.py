"""Compiled loops: what numpy can only do in many passes over memory."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def kernel(function: Function) -> Function:
    """Compile a function of arrays and numbers; the machine code is kept for the next process.

    Sums may be taken in another order than written, so that they can be vectorised; the order is
    the same for the same shapes on one machine. A division by zero gives infinity.
    """
    compile_ = numba.njit(
        cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"}
    )
    return cast(Function, compile_(function))
