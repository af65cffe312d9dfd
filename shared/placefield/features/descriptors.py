"""Features to descriptors: standardisation, PCA, unit length.

A raw feature is divided by its length (contrast varies with the light), standardised by the mean
and deviation of its traverse (the light and the camera of a traverse are common to all its frames),
reduced by PCA and divided by its length again, so that distances compare directions alone.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.config import FeatureKind
from placefield.features.network import Network

PRIOR_FRAMES = 20
"""Weight of the reference's mean and deviation in a young query's, frames."""

_LEAST_DEVIATION = 1e-6
_BLOCK = 512  # frames whose standardised features are held at once

Array = NDArray[np.float32]
Array64 = NDArray[np.float64]


@dataclass(frozen=True)
class DescriptorModel:
    """What the reference taught about making descriptors, of D raw and N reduced dimensions.

    Attributes:
        kind: of the raw features.
        standardise: whether a query's running mean and deviation replace the reference's.
        mean: (D,) float32, of the reference's raw features at unit length.
        deviation: (D,) float32, likewise.
        components: (N, D) float32, orthonormal rows: the principal axes.
        network: that the raw features are the output of, if so.
    """

    kind: FeatureKind
    standardise: bool
    mean: Array
    deviation: Array
    components: Array
    network: Network | None = None

    def of_reference(self, raws: Array) -> Array:
        """Make descriptors (..., N) of raw features (..., D), standardised as the reference is."""
        return self.reduce(_standardise(unit_length(raws), self.mean, self.deviation))

    def reduce(self, standardised: Array) -> Array:
        """Project standardised features (..., D) on the principal axes; unit length, (..., N)."""
        return unit_length(standardised @ self.components.T)


def unit_length(vectors: Array) -> Array:
    """Divide vectors (..., D) by their Euclidean lengths; a zero vector stays zero."""
    # As np.linalg.norm does it, in a fraction of its overhead on one vector.
    lengths = np.sqrt(np.sum(vectors * vectors, axis=-1, keepdims=True))
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1), np.float32)


def fit_descriptors(
    traverses: Sequence[Array],
    kind: FeatureKind,
    *,
    dimensions: int,
    standardise: bool,
    network: Network | None = None,
) -> tuple[DescriptorModel, list[Array]]:
    """Fit the model on reference traverses, and return it with their descriptors.

    Args:
        traverses: raw features of each, (K, D) float32; the first gives mean and deviation.
        kind: of the features.
        dimensions: N at most; fewer where there are fewer frames than that.
        standardise: whether every traverse after the first is standardised by its own mean and
            deviation, as a query will be.
        network: that the features are the output of, if so.

    Returns:
        The model, and for each traverse its descriptors, (K, N) float32.
    """
    moments = [_moments(traverse) for traverse in traverses]
    if not standardise:
        moments = [moments[0]] * len(traverses)

    def standardised() -> Iterator[Array]:
        for traverse, (mean, deviation) in zip(traverses, moments, strict=True):
            for block in blocks(len(traverse), _BLOCK):
                yield _standardise(unit_length(traverse[block]), mean, deviation)

    components = _principal_axes(standardised, dimensions)
    model = DescriptorModel(kind, standardise, *moments[0], components, network)
    reduced = np.concatenate([model.reduce(vectors) for vectors in standardised()])
    return model, np.split(reduced, np.cumsum([len(traverse) for traverse in traverses])[:-1])


def _moments(raws: Array) -> tuple[Array, Array]:
    """Mean and deviation of raw features (K, D) at unit length."""
    total = square_total = np.zeros(raws.shape[1])
    for block in blocks(len(raws), _BLOCK):
        units = unit_length(raws[block]).astype(np.float64)
        total = total + units.sum(axis=0)
        square_total = square_total + (units**2).sum(axis=0)
    mean = total / len(raws)
    deviation = np.sqrt(np.maximum(square_total / len(raws) - mean**2, _LEAST_DEVIATION**2))
    return mean.astype(np.float32), deviation.astype(np.float32)


def _standardise(vectors: Array, mean: Array, deviation: Array) -> Array:
    return (vectors - mean) / deviation


def _principal_axes(in_blocks: Callable[[], Iterator[Array]], dimensions: int) -> Array:
    """Principal axes (N, D) of vectors that come in blocks (B, D), of which few are held at once.

    Of their covariance, or, of vectors fewer than their dimensions, of themselves.
    """
    count, total = 0, np.zeros(1)
    for block in in_blocks():
        count, total = count + len(block), total + block.sum(axis=0, dtype=np.float64)
    mean = total / count
    if count <= len(mean):
        vectors = np.concatenate(list(in_blocks())) - mean.astype(np.float32)
        axes = np.linalg.svd(vectors, full_matrices=False)[2]
    else:
        covariance = np.zeros((len(mean), len(mean)))
        for block in in_blocks():
            centred = block - mean
            covariance += centred.T @ centred
        axes = np.linalg.eigh(covariance)[1].T[::-1]
    rank = min(dimensions, count - 1, len(mean))
    return np.ascontiguousarray(axes[:rank], np.float32)


class DescriptorStream:
    """Makes the raw features of a query into descriptors, frame by frame, looking back only.

    Mean and deviation run over the frames so far; the reference's count as ``PRIOR_FRAMES`` of
    them, so that a young stream is standardised like the reference.
    """

    def __init__(self, model: DescriptorModel) -> None:
        self._model = model
        self._frames = float(PRIOR_FRAMES)
        mean = model.mean.astype(np.float64)
        self._sum: Array64 = mean * PRIOR_FRAMES
        self._square_sum: Array64 = (
            model.deviation.astype(np.float64) ** 2 + mean**2
        ) * PRIOR_FRAMES

    def push(self, raw: Array) -> Array:
        """Take the next frame's raw feature (D,) and return its descriptor (N,) float32."""
        if not self._model.standardise:
            return self._model.of_reference(raw)
        unit = unit_length(raw)
        self._frames += 1
        self._sum += unit
        self._square_sum += unit.astype(np.float64) ** 2
        mean = self._sum / self._frames
        variance = np.maximum(self._square_sum / self._frames - mean**2, _LEAST_DEVIATION**2)
        standardised = (unit - mean) / np.sqrt(variance)
        return self._model.reduce(standardised.astype(np.float32))
