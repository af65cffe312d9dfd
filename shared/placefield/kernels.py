"""Compiled loops, for what numpy can only do in many passes over memory."""

import hashlib
import inspect
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, wraps
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numpy.typing import NDArray

Function = TypeVar("Function", bound=Callable[..., object])
_SCIPY_BLAS = "scipy.linalg.cython_blas"

_LANES = 64  # interleaved results, so that the compiler can vectorise


def _load_numba_without_scipy() -> None:
    """Load numba's array functions without SciPy's linear algebra, whose import takes 0.2 s.

    numba imports it as it loads them, and then uses it for correlations alone. Kernels have none.
    """
    modules: dict[str, ModuleType | None] = cast(Any, sys.modules)
    if _SCIPY_BLAS in modules:
        return
    modules[_SCIPY_BLAS] = None  # an import of it fails at once
    with suppress(ImportError):
        import_module("numba.np.arraymath")
    del modules[_SCIPY_BLAS]


_load_numba_without_scipy()


class _CacheFile(IndexDataCacheFile):
    """Files of machine code; those that cannot be read are treated as missing.

    A file may be cut off. It may also name a class that a later version calls otherwise.
    """

    def _load_index(self) -> dict[object, str]:
        try:
            return cast(dict[object, str], super()._load_index())  # type: ignore[no-untyped-call]
        except Exception:
            return {}

    def _load_data(self, name: str) -> object:
        try:
            return super()._load_data(name)  # type: ignore[no-untyped-call]
        except Exception as error:
            raise FileNotFoundError(name) from error


class _Cache(FunctionCache):
    """Caches machine code, keyed by the sources that it was compiled from.

    numba checks only a function's own file. But the functions that it calls are compiled into it,
    too, and so are the constants that it uses and the fields of named tuples that it takes,
    whatever file they are in.
    """

    def __init__(self, function: FunctionType) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        self._cache_file = _CacheFile(  # type: ignore[no-untyped-call]
            self._cache_path,
            self._impl.filename_base,
            self._impl.locator.get_source_stamp(),
        )
        self.sources = {_digest(__file__)}
        for given in function.__annotations__.values():
            if isinstance(given, type) and hasattr(given, "_fields"):
                self.sources.add(_digest(inspect.getfile(given)))
        for name in function.__code__.co_names:
            named = function.__globals__.get(name)
            called = getattr(named, "_cache", None)
            if isinstance(called, _Cache):
                self.sources |= {_digest(called.file), *called.sources}
            elif isinstance(named, (int, float, np.generic, np.ndarray)):
                self.sources.add(f"{name} = {np.asarray(named).tolist()}")
        self.file: str = function.__code__.co_filename

    def _index_key(self, sig: object, codegen: object) -> tuple[object, ...]:
        key = super()._index_key(sig, codegen)  # type: ignore[no-untyped-call]
        return (*key, tuple(sorted(self.sources)))

    def save_overload(self, sig: object, data: object) -> None:
        """Cache the compiled code; on a full disk it is compiled again next time."""
        with suppress(OSError):
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]


@cache
def _digest(file: str) -> str:
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


def _uninterrupted(compile_for: Function) -> Function:
    """Let Ctrl-C wait until a function is compiled.

    The compiler calls Python back, where the exception would be lost, and with it the machine code.
    """

    @wraps(compile_for)
    def compile_whole(*arguments: object) -> object:
        with _interrupt_later():
            return compile_for(*arguments)

    return cast(Function, compile_whole)


@contextmanager
def _interrupt_later() -> Iterator[None]:
    """Raise ``KeyboardInterrupt`` at the end of the block if Ctrl-C came meanwhile."""
    raises = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not raises or threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if came:
        raise KeyboardInterrupt


def kernel(function: Function) -> Function:
    """Compile a function of arrays and numbers; the machine code is cached for the next process.

    Arithmetic is as written, without unsafe optimisations: with those, the bits would depend on the
    other code in the process. A division by zero gives infinity.

    Loops over numbers compile several times faster than array expressions, sorts, searches and
    assignments of arrays to slices.
    """
    compiled: Any = numba.njit(nogil=True, error_model="numpy")(function)
    if compiled is function:  # numba leaves it interpreted: NUMBA_DISABLE_JIT is set
        return function
    compiled.compile = _uninterrupted(compiled.compile)
    with suppress(RuntimeError):  # there is no folder for the machine code
        compiled._cache = _Cache(cast(FunctionType, function))
    return cast(Function, compiled)


@kernel
def sum_of(values: NDArray[np.floating[Any]]) -> float:
    """Sum values (n,) in float64, as interleaved sums that are added up at the end."""
    sums = np.zeros(_LANES)
    even = len(values) - len(values) % _LANES
    for i in range(0, even, _LANES):
        for j in range(_LANES):
            sums[j] += values[i + j]
    for i in range(even, len(values)):
        sums[i - even] += values[i]
    total = 0.0
    for j in range(_LANES):
        total += sums[j]
    return total


@kernel
def pairwise_sum(values: NDArray[np.float64]) -> float:
    """Sum up to 128 values (n,) to the same bits as ``np.sum``: eight sums, added in pairs."""
    total, even = 0.0, len(values) - len(values) % 8
    if even > 0:
        sums = values[:8].copy()
        for i in range(8, even):
            sums[i % 8] += values[i]
        total = ((sums[0] + sums[1]) + (sums[2] + sums[3])) + (
            (sums[4] + sums[5]) + (sums[6] + sums[7])
        )
    for i in range(even, len(values)):
        total += values[i]
    return total


@kernel
def least_of(values: NDArray[np.floating[Any]]) -> float:
    """Return the least of values (n,), infinity if there is none."""
    lanes = np.full(_LANES, np.inf)
    even = len(values) - len(values) % _LANES
    for i in range(0, even, _LANES):
        for j in range(_LANES):
            lanes[j] = min(lanes[j], values[i + j])
    for i in range(even, len(values)):
        lanes[i - even] = min(lanes[i - even], values[i])
    least = np.inf
    for j in range(_LANES):
        least = min(least, lanes[j])
    return least
