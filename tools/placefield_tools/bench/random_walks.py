"""Synthetic descriptors: a random walk, and the same places observed again."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from placefield.blocks import blocks
from placefield.features.descriptors import unit_length
from placefield.search.quantized import DESCRIPTOR_UNIT, Quantized, quantize

_KEPT = 0.9  # of a descriptor from one place to the next
_REVISITED = 100  # places of a stretch that the walk passes a second time
_STRETCHES = 0.001  # for each place
_CHANGE = 0.3  # strength of the noise that sets a second pass apart
_BLOCK = 2**16  # places whose float32 descriptors are held at once

Array = NDArray[np.float32]


def random_walk(places: int, dimensions: int, seed: int) -> Array:
    """Walk at random, (places, dimensions) float32 of length 1, some stretches twice.

    Variances fall off from dimension to dimension as those of principal axes do.
    """
    rng = np.random.default_rng(seed)
    walk = np.empty((places, dimensions), np.float32)
    for dimension, spread in enumerate(_spreads(dimensions)):
        noise = rng.standard_normal(places, np.float32) * spread
        walk[:, dimension] = lfilter([np.sqrt(1 - _KEPT**2)], [1, -_KEPT], noise)
    for _ in range(int(places * _STRETCHES)):
        here, there = rng.integers(0, places - _REVISITED, 2)
        stretch = walk[there : there + _REVISITED].copy()
        walk[here : here + _REVISITED] = stretch + _CHANGE * _noise(rng, stretch.shape)
    return _in_place_unit_length(walk)


def write_random_walk(walk: Quantized, seed: int) -> None:
    """Write such a walk, quantized, into an array (places, dimensions) int16, block by block.

    It is another walk than that of ``random_walk``. The array may be mapped from a file.
    """
    rng = np.random.default_rng(seed)
    count, dimensions = walk.shape
    strength, last = np.linalg.norm(_spreads(dimensions)), np.zeros((1, dimensions))
    for block in blocks(count, _BLOCK):
        noise = _noise(rng, (block.stop - block.start, dimensions))
        some, last = lfilter([np.sqrt(1 - _KEPT**2)], [1, -_KEPT], noise, axis=0, zi=last)
        walk[block] = quantize(_in_place_unit_length(some.astype(np.float32)), DESCRIPTOR_UNIT)
    for _ in range(int(count * _STRETCHES)):
        here, there = rng.integers(0, count - _REVISITED, 2)
        stretch = walk[there : there + _REVISITED] * np.float32(DESCRIPTOR_UNIT)
        stretch += _CHANGE / strength * _noise(rng, stretch.shape)
        passed = quantize(_in_place_unit_length(stretch), DESCRIPTOR_UNIT)
        walk[here : here + _REVISITED] = passed


def observed_again(places: Array, strength: float, seed: int) -> Array:
    """Observe places (Q, N) again, in another light: add noise of this strength."""
    noise = _noise(np.random.default_rng(seed), places.shape)
    noise *= strength / np.linalg.norm(_spreads(places.shape[1]))
    return unit_length(places + noise)


def drive_along(places: int, frames: int, seed: int) -> NDArray[np.int64]:
    """Drive along a map at varied speed, carried elsewhere every 100 frames: (frames,) places."""
    rng = np.random.default_rng(seed)
    steps = rng.choice([0.5, 0.75, 1.0, 1.25, 1.5, 2.0], -(-frames // 20)).repeat(20)
    driven = []
    for start in range(0, frames, 100):
        stretch = np.cumsum(steps[start : min(start + 100, frames)])
        begin = rng.uniform(0, max(places - stretch[-1], 1))
        driven.append(np.minimum(begin + stretch, places - 1))
    return np.concatenate(driven).astype(np.int64)


def near_identity(dimensions: int, seed: int) -> Array:
    """Make a projection (dimensions, dimensions) float32 as learners make them."""
    noise = np.random.default_rng(seed).standard_normal((dimensions, dimensions))
    return np.asarray(np.eye(dimensions) + 0.5 / np.sqrt(dimensions) * noise, np.float32)


def _spreads(dimensions: int) -> Array:
    return (1 / np.sqrt(1 + np.arange(dimensions) / 10)).astype(np.float32)


def _noise(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    return rng.standard_normal(shape, np.float32) * _spreads(shape[1])


def _in_place_unit_length(vectors: Array) -> Array:
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors
