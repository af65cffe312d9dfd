"""Features to descriptors: standardisation, PCA, unit length.

A raw feature is divided by its length, because contrast varies with the light. It is standardised
by the mean and deviation of its traverse, because all frames of a traverse share the light and the
camera. It is reduced by PCA and divided by its length again, so that distances compare directions
only.

Plain PCA, as published, subtracts the mean of the raw features and projects. The result is scaled
so that no descriptor is longer than 1, and both kinds can be stored in the same way. A common scale
does not change which place is the nearest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.config import FeatureKind
from placefield.errors import FrameError
from placefield.features.calibration import View
from placefield.features.network import Network

if TYPE_CHECKING:  # a router has no OpenCV
    from placefield.features.mask import Mask

PRIOR_FRAMES = 20
"""Weight of the reference's mean and deviation at the start of a query, frames."""

_LEAST_DEVIATION = 1e-6
_BLANK = 1e-5  # of the largest value: the raw features of a blank image differ only by rounding
_ROUNDED = 1e-3  # tolerance of a descriptor's length around 1
_FARTHEST = 4.0  # plain PCA: a query's descriptor may be this many times as long as any place's
_BLOCK = 512  # frames whose standardised features are held at once

Array = NDArray[np.float32]
Array64 = NDArray[np.float64]


@dataclass(frozen=True)
class DescriptorModel:
    """The model that turns raw features (D,) into descriptors (N,), fitted on the reference.

    Attributes:
        kind: of the raw features.
        standardise: whether a query's running mean and deviation replace the reference's.
        mean: (D,) float32, of the reference's raw features at unit length; with plain PCA, of the
            features without normalisation.
        deviation: (D,) float32, likewise; with plain PCA, the scale of descriptors, D times.
        components: (N, D) float32, orthonormal rows: the principal axes.
        variance_kept: fraction of the reference's variance along the principal axes, 0 to 1.
        plain: whether this is plain PCA, which neither standardises nor normalises to unit length,
            whatever ``standardise`` says.
        network: the network that gives the raw features, if one does.
        mask: hides a part of each image first; None: nothing is hidden.
        view: that each image is rectified to before; None: images are used as they are.
    """

    kind: FeatureKind
    standardise: bool
    mean: Array
    deviation: Array
    components: Array
    variance_kept: float
    plain: bool = False
    network: Network | None = None
    mask: Mask | None = None
    view: View | None = None

    def __repr__(self) -> str:
        reduced, raw = self.components.shape
        return f"DescriptorModel({self.kind}, {raw} to {reduced} dimensions)"

    @property
    def follows_query(self) -> bool:
        """Whether a descriptor depends on the frames of the stream before it."""
        return self.standardise and not self.plain

    def of_reference(self, raws: Array) -> Array:
        """Return descriptors (..., N) of raw features (..., D), standardised like the reference."""
        if self.plain:
            return self.reduce(_standardise(raws, self.mean, self.deviation))
        return self.reduce(_standardise(unit_length(raws), self.mean, self.deviation))

    def of_traverse(self, raws: Array) -> Array:
        """Return the descriptors (K, N) of a further traverse's raw features (K, D).

        They are standardised by the traverse's own mean and deviation, as those of a query are by
        its running ones. This is not for plain PCA.
        """
        moments = _moments(raws) if self.follows_query else (self.mean, self.deviation)
        return np.concatenate([self.reduce(block) for block in _standardised(raws, moments)])

    def reduce(self, standardised: Array) -> Array:
        """Project standardised features (..., D) on the principal axes, (..., N).

        The result has unit length, except with plain PCA.
        """
        reduced = standardised @ self.components.T
        return reduced if self.plain else unit_length(reduced)

    def restored(self, descriptors: Array) -> Array:
        """Return raw features (K, D) that give about these descriptors (K, N) of places.

        What the principal axes do not keep is lost. The length of the standardised feature, which a
        descriptor does not keep either, is taken to be the usual one.
        """
        standardised = descriptors @ self.components
        if not self.plain:
            standardised *= np.float32(np.sqrt(self.variance_kept * len(self.mean)))
        return np.asarray(self.mean + self.deviation * standardised, np.float32)

    def checked(self, descriptor: Array) -> Array | None:
        """Check an external descriptor (N,); return None if its length is 0 (no observation).

        A descriptor that is too long would overflow in the matching. One that is not finite would
        spoil the rest of its stream. One that is too short would be matched by its rounding errors
        (plain PCA allows any shorter length).

        Raises:
            FrameError: its shape or its length is not that of a descriptor of this model.
        """
        dimensions = len(self.components)
        if descriptor.shape != (dimensions,):
            raise FrameError(f"descriptor of shape {descriptor.shape}, not ({dimensions},)")
        length = float(np.linalg.norm(descriptor.astype(np.float64)))
        if length == 0:
            return None
        if self.plain and length <= 1:
            return descriptor
        if not abs(length - 1) <= _ROUNDED or self.plain:  # nor is NaN
            raise FrameError(f"descriptor of length {length:.3g}, not 1" + " at most" * self.plain)
        return descriptor


def unit_length(vectors: Array) -> Array:
    """Divide vectors (..., D) by their Euclidean lengths; a zero vector stays zero."""
    # The same bits as np.linalg.norm, with a fraction of its overhead on one vector.
    lengths = np.sqrt(np.sum(vectors * vectors, axis=-1, keepdims=True))
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1), np.float32)


def is_blank(raw: Array) -> bool:
    """Whether a raw feature (D,) is constant, as that of a blank image in the dark or in fog."""
    return bool(np.ptp(raw) <= _BLANK * np.abs(raw).max())


def fit_descriptors(
    traverses: Sequence[Array],
    kind: FeatureKind,
    *,
    dimensions: int,
    standardise: bool,
    plain: bool = False,
    network: Network | None = None,
    routes: int = 1,
) -> tuple[DescriptorModel, list[Array]]:
    """Fit the model on reference traverses, and return it with their descriptors.

    Args:
        traverses: raw features of each, (K, D) float32; the first give mean and deviation.
        kind: of the features.
        dimensions: the largest N; it is smaller if there are fewer frames.
        standardise: whether each further traverse is standardised by its own mean and deviation,
            as a query is.
        plain: whether to fit plain PCA instead.
        network: the network that gave the features, if one did.
        routes: so many of the first traverses are of different routes, which count equally in the
            mean and in the squared deviation of the model.

    Returns:
        The model, and the descriptors of each traverse, (K, N) float32.
    """
    if plain:
        return _fit_plain(traverses, kind, dimensions, standardise, network, routes)
    moments = [_moments(traverse) for traverse in traverses]
    shared = _mean_moments(moments[:routes])
    if not standardise:
        moments = [shared] * len(traverses)

    def standardised() -> Iterator[Iterator[Array]]:
        return map(_standardised, traverses, moments)

    components, kept = _principal_axes(lambda: chain.from_iterable(standardised()), dimensions)
    model = DescriptorModel(
        kind, standardise, *shared, components, variance_kept=kept, network=network
    )
    return model, [
        np.concatenate([model.reduce(block) for block in traverse]) for traverse in standardised()
    ]


def _fit_plain(
    traverses: Sequence[Array],
    kind: FeatureKind,
    dimensions: int,
    standardise: bool,
    network: Network | None,
    routes: int,
) -> tuple[DescriptorModel, list[Array]]:
    """Fit plain PCA, scaled so that no descriptor of the traverses is longer than 1/4."""
    means = [traverse.mean(axis=0, dtype=np.float64) for traverse in traverses[:routes]]
    mean = np.mean(means, axis=0).astype(np.float32)
    units = np.ones_like(mean)

    def centred() -> Iterator[Array]:
        return (raws[rows] - mean for raws in traverses for rows in blocks(len(raws), _BLOCK))

    components, kept = _principal_axes(centred, dimensions)
    longest = max(np.linalg.norm(block @ components.T, axis=1).max() for block in centred())
    unit = units * np.float32(_FARTHEST * longest or 1)
    model = DescriptorModel(
        kind, standardise, mean, unit, components, variance_kept=kept, plain=True, network=network
    )
    return model, [
        np.concatenate([model.of_reference(raws[rows]) for rows in blocks(len(raws), _BLOCK)])
        for raws in traverses
    ]


def _standardised(raws: Array, moments: tuple[Array, Array]) -> Iterator[Array]:
    """Yield a traverse's raw features (K, D) standardised, in blocks (B, D)."""
    for block in blocks(len(raws), _BLOCK):
        yield _standardise(unit_length(raws[block]), *moments)


def _moments(raws: Array) -> tuple[Array, Array]:
    """Return mean and deviation of raw features (K, D) at unit length."""
    total = square_total = np.zeros(raws.shape[1])
    for block in blocks(len(raws), _BLOCK):
        units = unit_length(raws[block]).astype(np.float64)
        total = total + units.sum(axis=0)
        square_total = square_total + (units**2).sum(axis=0)
    mean = total / len(raws)
    deviation = np.sqrt(np.maximum(square_total / len(raws) - mean**2, _LEAST_DEVIATION**2))
    return mean.astype(np.float32), deviation.astype(np.float32)


def _mean_moments(moments: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return the mean of means, and the deviation whose square is the mean of the squares."""
    means, deviations = (np.array(each, np.float64) for each in zip(*moments, strict=True))
    deviation = np.sqrt(np.mean(deviations**2, axis=0))
    return np.mean(means, axis=0).astype(np.float32), deviation.astype(np.float32)


def _standardise(vectors: Array, mean: Array, deviation: Array) -> Array:
    return (vectors - mean) / deviation


def _principal_axes(
    in_blocks: Callable[[], Iterator[Array]], dimensions: int
) -> tuple[Array, float]:
    """Return the principal axes (N, D) of vectors, and the fraction of the variance along them.

    The vectors come in blocks (B, D), so that few are in memory at once. The axes are computed
    from the covariance, or by SVD of the vectors if these are fewer than their dimensions.
    """
    count, total = 0, np.zeros(1)
    for block in in_blocks():
        count, total = count + len(block), total + block.sum(axis=0, dtype=np.float64)
    mean = total / count
    if count <= len(mean):
        vectors = np.concatenate(list(in_blocks())) - mean.astype(np.float32)
        _, lengths, axes = np.linalg.svd(vectors, full_matrices=False)
        variances = lengths.astype(np.float64) ** 2
    else:
        covariance = np.zeros((len(mean), len(mean)))
        for block in in_blocks():
            centred = block - mean
            covariance += centred.T @ centred
        ascending, columns = np.linalg.eigh(covariance)
        variances, axes = ascending[::-1], columns.T[::-1]
    rank = min(dimensions, count - 1, len(mean))
    kept = float(variances[:rank].sum() / (variances.sum() or 1))
    return np.ascontiguousarray(axes[:rank], np.float32), min(max(kept, 0.0), 1.0)


@dataclass(frozen=True)
class Moments:
    """First and second moments of a stream of raw features so far.

    Attributes:
        frames: number of frames, with the prior's weight.
        sums: (2, D) float64, sums of the features at unit length, and of their squares.
    """

    frames: float
    sums: Array64


class DescriptorStream:
    """Turns the raw features of a query into descriptors, frame by frame and causally.

    Mean and deviation are running ones. The reference's moments count as ``PRIOR_FRAMES`` frames,
    so that the start of a stream is standardised like the reference.
    """

    def __init__(self, model: DescriptorModel, moments: Moments | None = None) -> None:
        """Begin a stream, or continue one whose moments so far are given."""
        self._model = model
        self.moments = moments or _moments_of_reference(model)
        """The moments of the stream so far."""

    def update(self, raw: Array) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame's raw feature (D,).

        A constant raw feature, as of a blank image in the dark or in fog, gives None, and leaves
        the stream unchanged.

        Raises:
            FrameError: the feature has another shape, is not finite or, with plain PCA, is more
                than 4 times as far from the reference's mean as any place; the stream is unchanged.
        """
        self._check(raw)
        if is_blank(raw):
            return None
        if not self._model.follows_query:
            return self._model.checked(self._model.of_reference(raw))
        unit = unit_length(raw)
        frames = self.moments.frames + 1
        sums = self.moments.sums + np.stack([unit, unit.astype(np.float64) ** 2])
        self.moments = Moments(frames, sums)
        mean, square_mean = sums / frames
        variance = np.maximum(square_mean - mean**2, _LEAST_DEVIATION**2)
        standardised = (unit - mean) / np.sqrt(variance)
        return self._model.reduce(standardised.astype(np.float32))

    def _check(self, raw: Array) -> None:
        """Refuse a wrong shape or a value that is not finite, which would spoil all later sums."""
        expected = self._model.mean.shape
        if raw.shape != expected:
            raise FrameError(f"feature of shape {raw.shape}, not {expected}")
        if not np.isfinite(raw).all():
            raise FrameError("the feature is not finite")


def _moments_of_reference(model: DescriptorModel) -> Moments:
    mean = model.mean.astype(np.float64)
    square_mean = model.deviation.astype(np.float64) ** 2 + mean**2
    return Moments(float(PRIOR_FRAMES), np.stack([mean, square_mean]) * PRIOR_FRAMES)
