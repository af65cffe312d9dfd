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

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from placefield.blocks import blocks
from placefield.errors import FrameError
from placefield.features.calibration import View
from placefield.features.kinds import FeatureKind
from placefield.features.network import Network

if TYPE_CHECKING:  # a router has no OpenCV
    from placefield.features.mask import Mask

PRIOR_FRAMES = 20
"""Weight of the reference's mean and deviation at the start of a query, frames."""

_LEAST_DEVIATION = 1e-6
_BLANK = 1e-5  # of the largest value: the raw features of a blank image differ only by rounding
_ROUNDED = 1e-3  # tolerance of a descriptor's length around 1
BLOCK = 512
"""Frames whose standardised features are held at once."""

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
        least_side: pixels that the shorter side of an image has at least if it is decoded to a part
            of its size, see ``images.decode``; None: images are decoded whole.
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
    least_side: int | None = None

    def __repr__(self) -> str:
        reduced, raw = self.components.shape
        return f"DescriptorModel({self.kind}, {raw} to {reduced} dimensions)"

    @property
    def parts(self) -> tuple[DescriptorModel, ...]:
        """The models of the parts of the feature: this one, see ``JoinedModel``."""
        return (self,)

    @property
    def raw_dimensions(self) -> int:
        """D, of the raw features."""
        return len(self.mean)

    @property
    def dimensions(self) -> int:
        """N, of the descriptors."""
        return len(self.components)

    @property
    def follows_query(self) -> bool:
        """Whether a descriptor depends on the frames of the stream before it."""
        return self.standardise and not self.plain

    def new_stream(self, moments: Moments | None = None) -> DescriptorStream:
        """Begin a stream of raw features, or continue one whose moments so far are given."""
        return DescriptorStream(self, moments)

    def of_reference(self, raws: Array) -> Array:
        """Return descriptors (..., N) of raw features (..., D), standardised like the reference."""
        if self.plain:
            return self.reduce(standardise(raws, self.mean, self.deviation))
        return self.reduce(standardise(unit_length(raws), self.mean, self.deviation))

    def of_traverse(self, raws: Array) -> Array:
        """Return the descriptors (K, N) of a further traverse's raw features (K, D).

        They are standardised by the traverse's own mean and deviation, as those of a query are by
        its running ones. This is not for plain PCA.
        """
        moments = moments_of_raws(raws) if self.follows_query else (self.mean, self.deviation)
        return np.concatenate([self.reduce(block) for block in standardised(raws, moments)])

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
        return checked_length(descriptor, self.dimensions, plain=self.plain)


def checked_length(descriptor: Array, dimensions: int, *, plain: bool) -> Array | None:
    """Check shape and length of a descriptor, see ``DescriptorModel.checked``."""
    if descriptor.shape != (dimensions,):
        raise FrameError(f"descriptor of shape {descriptor.shape}, not ({dimensions},)")
    length = float(np.linalg.norm(descriptor.astype(np.float64)))
    if length == 0:
        return None
    if plain and length <= 1:
        return descriptor
    if not abs(length - 1) <= _ROUNDED or plain:  # nor is NaN
        raise FrameError(f"descriptor of length {length:.3g}, not 1" + " at most" * plain)
    return descriptor


def unit_length(vectors: Array) -> Array:
    """Divide vectors (..., D) by their Euclidean lengths; a zero vector stays zero."""
    # The same bits as np.linalg.norm, with a fraction of its overhead on one vector.
    lengths = np.sqrt(np.sum(vectors * vectors, axis=-1, keepdims=True))
    return np.asarray(vectors / np.where(lengths > 0, lengths, 1), np.float32)


def check_raw(raw: Array, dimensions: int) -> None:
    """Refuse a wrong shape or a value that is not finite, which would spoil all later sums.

    Raises:
        FrameError: the raw feature is not of the shape ``(dimensions,)``, or not finite.
    """
    if raw.shape != (dimensions,):
        raise FrameError(f"feature of shape {raw.shape}, not ({dimensions},)")
    if not np.isfinite(raw).all():
        raise FrameError("the feature is not finite")


def is_blank(raw: Array) -> bool:
    """Whether a raw feature (D,) is constant, as that of a blank image in the dark or in fog."""
    return bool(np.ptp(raw) <= _BLANK * np.abs(raw).max())


def standardised(raws: Array, moments: tuple[Array, Array]) -> Iterator[Array]:
    """Yield a traverse's raw features (K, D) standardised, in blocks (B, D)."""
    for block in blocks(len(raws), BLOCK):
        yield standardise(unit_length(raws[block]), *moments)


def moments_of_raws(raws: Array) -> tuple[Array, Array]:
    """Return mean and deviation of raw features (K, D) at unit length."""
    total = square_total = np.zeros(raws.shape[1])
    for block in blocks(len(raws), BLOCK):
        units = unit_length(raws[block]).astype(np.float64)
        total = total + units.sum(axis=0)
        square_total = square_total + (units**2).sum(axis=0)
    mean = total / len(raws)
    deviation = np.sqrt(np.maximum(square_total / len(raws) - mean**2, _LEAST_DEVIATION**2))
    return mean.astype(np.float32), deviation.astype(np.float32)


def standardise(vectors: Array, mean: Array, deviation: Array) -> Array:
    """Subtract a mean (D,) from vectors (..., D) and divide them by a deviation (D,)."""
    return (vectors - mean) / deviation


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
        check_raw(raw, self._model.raw_dimensions)
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


def _moments_of_reference(model: DescriptorModel) -> Moments:
    mean = model.mean.astype(np.float64)
    square_mean = model.deviation.astype(np.float64) ** 2 + mean**2
    return Moments(float(PRIOR_FRAMES), np.stack([mean, square_mean]) * PRIOR_FRAMES)
