"""A check of a feature of another package, for that package's own tests."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

_SHAPES = ((480, 640, 3), (360, 640), (48, 64, 3), (90, 40, 3), (64, 64))
_THREADS = 4
_ROUNDED = 1e-4  # of the largest value: networks add in another order in a batch

Array = NDArray[np.float32]
Pixels = NDArray[np.uint8]


def check_feature(
    describe: Callable[[Sequence[Pixels]], Array], images: Sequence[Pixels] | None = None
) -> None:
    """Check that a function keeps the contract of a feature.

    It gives finite float32 (B, D), the same D for images of any size and colour, and the same bits
    for an image in every call: after other images, and in several threads at once. In a batch, an
    image has the same vector as alone, but for rounding. The images are read-only, as those from
    the bus are.

    Args:
        describe: the function that the entry point names.
        images: at least two different ones, uint8, (H, W) grey or (H, W, 3) BGR; None: noise of
            several sizes.

    Raises:
        AssertionError: the function breaks the contract; the message says how. Whatever the
            function itself raises is raised, too.
    """
    given = [_read_only(image) for image in (_noise() if images is None else images)]
    alone = [_described(describe, [image]) for image in given]
    dimensions = sorted({vectors.shape[1] for vectors in alone})
    _require(len(dimensions) == 1, f"gives vectors of {dimensions} numbers for different images")
    _require(dimensions[0] > 1, "gives a single number; a feature needs two or more")
    vectors = np.concatenate(alone)
    _require(len(np.unique(vectors, axis=0)) > 1, "gives one vector for different images")

    again = [_described(describe, [image]) for image in reversed(given)][::-1]
    _require_same(again, alone, "gives another vector for an image after other images")
    with ThreadPoolExecutor(_THREADS) as pool:
        at_once = list(pool.map(lambda image: _described(describe, [image]), given * _THREADS))
    _require_same(at_once, alone * _THREADS, "gives another vector in several threads at once")

    batch = _described(describe, given)
    difference = float(np.abs(batch - vectors).max() / np.abs(vectors).max())
    _require(
        difference <= _ROUNDED,
        f"gives other vectors in a batch: they differ by {difference:.2g} of the largest number",
    )


def _noise() -> list[Pixels]:
    rng = np.random.default_rng(0)
    return [rng.integers(0, 256, shape, np.uint8) for shape in _SHAPES]


def _read_only(image: Pixels) -> Pixels:
    copied = image.copy()
    copied.flags.writeable = False
    return copied


def _described(
    describe: Callable[[Sequence[Pixels]], Array], images: Sequence[Pixels]
) -> NDArray[np.float32]:
    vectors = describe(images)
    kind = vectors.dtype if isinstance(vectors, np.ndarray) else type(vectors).__name__
    _require(
        isinstance(vectors, np.ndarray) and vectors.dtype == np.float32,
        f"gives {kind}; it has to give an array of float32",
    )
    _require(
        vectors.ndim == 2 and len(vectors) == len(images),
        f"gives shape {vectors.shape} for {len(images)} images; it has to give (B, D)",
    )
    _require(bool(np.isfinite(vectors).all()), "gives numbers that are not finite")
    return vectors


def _require_same(given: Sequence[Array], expected: Sequence[Array], otherwise: str) -> None:
    _require(all(map(np.array_equal, given, expected)), otherwise)


def _require(condition: bool, otherwise: str) -> None:
    if not condition:  # also under python -O, and without the rewriting of pytest
        raise AssertionError(f"the feature {otherwise}")
