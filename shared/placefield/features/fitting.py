"""Fits descriptor models on the raw features of reference traverses."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain

import numpy as np

from placefield.blocks import blocks
from placefield.features.descriptors import (
    BLOCK,
    Array,
    DescriptorModel,
    moments_of_raws,
    standardised,
)
from placefield.features.kinds import FeatureKind
from placefield.features.network import Network

_PASSES = 3  # over all frames: for their mean, for their covariance, and to reduce them
_FARTHEST = 4.0  # plain PCA: a query's descriptor may be this many times as long as any place's


def fit_descriptors(
    traverses: Sequence[Array],
    kind: FeatureKind,
    *,
    dimensions: int,
    standardise: bool,
    plain: bool = False,
    network: Network | None = None,
    routes: int = 1,
    progress: Callable[[float], None] = lambda share: None,
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
        progress: called with the fraction that is done; an exception of it ends the work.

    Returns:
        The model, and the descriptors of each traverse, (K, N) float32.
    """
    if plain:
        return _fit_plain(traverses, kind, dimensions, standardise, network, routes)
    moments = [moments_of_raws(traverse) for traverse in traverses]
    shared = _mean_moments(moments[:routes])
    if not standardise:
        moments = [shared] * len(traverses)

    reported = _reported(sum(map(len, traverses)), progress)

    def in_blocks() -> Iterator[Iterator[Array]]:
        return map(reported, map(standardised, traverses, moments))

    components, kept = _principal_axes(lambda: chain.from_iterable(in_blocks()), dimensions)
    model = DescriptorModel(
        kind, standardise, *shared, components, variance_kept=kept, network=network
    )
    return model, [
        _joined(map(model.reduce, in_block), (len(raws), model.dimensions))
        for raws, in_block in zip(traverses, in_blocks(), strict=True)
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
        return (raws[rows] - mean for raws in traverses for rows in blocks(len(raws), BLOCK))

    components, kept = _principal_axes(centred, dimensions)
    longest = max(np.linalg.norm(block @ components.T, axis=1).max() for block in centred())
    unit = units * np.float32(_FARTHEST * longest or 1)
    model = DescriptorModel(
        kind, standardise, mean, unit, components, variance_kept=kept, plain=True, network=network
    )
    return model, [
        _joined(
            (model.of_reference(raws[rows]) for rows in blocks(len(raws), BLOCK)),
            (len(raws), model.dimensions),
        )
        for raws in traverses
    ]


def _reported(
    frames: int, progress: Callable[[float], None]
) -> Callable[[Iterable[Array]], Iterator[Array]]:
    """Return what yields blocks of frames, and reports the fraction of all passes over them."""
    done = 0

    def reported(in_blocks: Iterable[Array]) -> Iterator[Array]:
        nonlocal done
        for block in in_blocks:
            yield block
            done += len(block)
            progress(done / (_PASSES * frames))

    return reported


def _joined(in_blocks: Iterable[Array], shape: tuple[int, int]) -> Array:
    """Join blocks of rows to an array of this shape, without holding them all beside it."""
    joined, end = np.empty(shape, np.float32), 0
    for block in in_blocks:
        joined[end : end + len(block)] = block
        end += len(block)
    return joined


def _mean_moments(moments: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return the mean of means, and the deviation whose square is the mean of the squares."""
    means, deviations = (np.array(each, np.float64) for each in zip(*moments, strict=True))
    deviation = np.sqrt(np.mean(deviations**2, axis=0))
    return np.mean(means, axis=0).astype(np.float32), deviation.astype(np.float32)


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
