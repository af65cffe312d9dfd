"""The descriptor model of a feature of several parts, such as GIST and a network.

Each part has a descriptor model of its own. The descriptors of the parts are put one after the
other and divided by √P, where P is the number of parts. So the squared distance of two descriptors
is the mean of the squared distances of their parts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from placefield.features.calibration import View
from placefield.features.descriptors import (
    Array,
    DescriptorModel,
    DescriptorStream,
    Moments,
    check_raw,
    checked_length,
    is_blank,
)
from placefield.features.fitting import fit_descriptors
from placefield.features.kinds import ONNX, FeatureKind, kind_of
from placefield.features.network import Network

if TYPE_CHECKING:  # a router has no OpenCV
    from placefield.features.mask import Mask


Real = TypeVar("Real", np.float32, np.float64)


class FeaturePart(NamedTuple):
    """A part of a feature.

    Attributes:
        kind: of the part.
        network: the network that it runs; None if it needs none.
        width: D, how many numbers of the raw feature are its own; None if it is the only part.
        least_side: see ``DescriptorModel``.
    """

    kind: FeatureKind
    network: Network | None
    width: int | None
    least_side: int | None = None


@dataclass(frozen=True)
class JoinedModel:
    """The model that turns raw features of several parts, one after the other, into descriptors.

    Attributes:
        parts: the model of each part, two or more, which are alike but in their features.
        mask: hides a part of each image first; None: nothing is hidden.
        view: that each image is rectified to before; None: images are used as they are.
    """

    parts: tuple[DescriptorModel, ...]
    mask: Mask | None = None
    view: View | None = None

    def __repr__(self) -> str:
        return f"JoinedModel({', '.join(map(repr, self.parts))})"

    @property
    def kind(self) -> FeatureKind:
        """The kinds of the parts, joined by a plus sign."""
        return kind_of(part.kind for part in self.parts)

    @property
    def standardise(self) -> bool:
        """See ``DescriptorModel``."""
        return self.parts[0].standardise

    @property
    def plain(self) -> bool:
        """See ``DescriptorModel``."""
        return self.parts[0].plain

    @property
    def least_side(self) -> int | None:
        """See ``DescriptorModel``."""
        return least_side_for([part.least_side for part in self.parts])

    @property
    def follows_query(self) -> bool:
        """Whether a descriptor depends on the frames of the stream before it."""
        return self.parts[0].follows_query

    @property
    def variance_kept(self) -> float:
        """Mean fraction of the reference's variance that the parts keep, 0 to 1."""
        return float(np.mean([part.variance_kept for part in self.parts]))

    @property
    def raw_dimensions(self) -> int:
        """D, of the raw features."""
        return sum(part.raw_dimensions for part in self.parts)

    @property
    def dimensions(self) -> int:
        """N, of the descriptors."""
        return sum(part.dimensions for part in self.parts)

    def split(self, raws: NDArray[Real]) -> list[NDArray[Real]]:
        """Return the columns of each part, (..., Dp), of raw features or their sums (..., D)."""
        return split_columns(raws, [part.raw_dimensions for part in self.parts])

    def of_reference(self, raws: Array) -> Array:
        """Return descriptors (..., N) of raw features (..., D), standardised like the reference."""
        return join([part.of_reference(own) for part, own in self._of_parts(raws)])

    def of_traverse(self, raws: Array) -> Array:
        """Return the descriptors (K, N) of a further traverse, see ``DescriptorModel``."""
        return join([part.of_traverse(own) for part, own in self._of_parts(raws)])

    def restored(self, descriptors: Array) -> Array:
        """Return raw features (K, D) that give about these descriptors, see ``DescriptorModel``."""
        own = split_columns(descriptors, [part.dimensions for part in self.parts])
        scale = np.float32(np.sqrt(len(self.parts)))
        restored = [part.restored(one * scale) for part, one in zip(self.parts, own, strict=True)]
        return np.concatenate(restored, axis=-1)

    def checked(self, descriptor: Array) -> Array | None:
        """Check an external descriptor (N,), see ``DescriptorModel.checked``.

        Raises:
            FrameError: its shape or its length is not that of a descriptor of this model.
        """
        return checked_length(descriptor, self.dimensions, plain=self.plain)

    def new_stream(self, moments: Moments | None = None) -> JoinedStream:
        """Begin a stream of raw features, or continue one whose moments so far are given."""
        return JoinedStream(self, moments)

    def _of_parts(self, raws: Array) -> Iterator[tuple[DescriptorModel, Array]]:
        return zip(self.parts, self.split(raws), strict=True)


AnyModel = DescriptorModel | JoinedModel
"""The descriptor model of a map."""


class JoinedStream:
    """Turns the raw features of a query into descriptors, each part by a stream of its own."""

    def __init__(self, model: JoinedModel, moments: Moments | None = None) -> None:
        """Begin a stream, or continue one whose moments so far are given."""
        self._model = model
        parts: list[Moments | None] = [None] * len(model.parts)
        if moments is not None:
            parts = [Moments(moments.frames, sums) for sums in model.split(moments.sums)]
        self._streams = [
            DescriptorStream(part, own) for part, own in zip(model.parts, parts, strict=True)
        ]

    @property
    def moments(self) -> Moments:
        """The moments of the stream so far."""
        own = [stream.moments for stream in self._streams]
        return Moments(own[0].frames, np.concatenate([each.sums for each in own], axis=1))

    def update(self, raw: Array) -> Array | None:
        """Return the descriptor (N,) float32 of the next frame's raw feature (D,).

        If a part is blank, it returns None, and leaves the stream unchanged.

        Raises:
            FrameError: see ``DescriptorStream.update``; the stream is unchanged.
        """
        check_raw(raw, self._model.raw_dimensions)
        own = self._model.split(raw)
        if any(map(is_blank, own)):
            return None
        described = [stream.update(part) for stream, part in zip(self._streams, own, strict=True)]
        joined = [one for one in described if one is not None]
        return join(joined) if len(joined) == len(described) else None


def fit_parts(
    traverses: Sequence[Array],
    parts: Sequence[FeaturePart],
    *,
    dimensions: Sequence[int],
    standardise: bool,
    plain: bool,
    routes: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[AnyModel, list[Array]]:
    """Fit the model of a feature of one or more parts, see ``fit_descriptors``.

    Args:
        traverses: raw features of each, (K, D) float32.
        parts: of the feature, see ``Feature.parts``.
        dimensions: the largest N of each part.
        standardise: see ``fit_descriptors``.
        plain: likewise.
        routes: likewise.
        progress: likewise.

    Returns:
        The model, and the descriptors of each traverse, (K, N) float32.
    """
    widths = [part.width or 0 for part in parts]
    split = [split_columns(raws, widths) for raws in traverses]
    fitted = [
        fit_descriptors(
            [own[number] for own in split],
            part.kind,
            dimensions=largest,
            standardise=standardise,
            plain=plain,
            network=part.network,
            routes=routes,
            progress=partial(_of_part, progress, number, len(parts)),
        )
        for number, (part, largest) in enumerate(zip(parts, dimensions, strict=True))
    ]
    models = tuple(
        replace(model, least_side=part.least_side)
        for (model, _), part in zip(fitted, parts, strict=True)
    )
    if len(models) == 1:
        return models[0], fitted[0][1]
    described = [own for _, own in fitted]
    return JoinedModel(models), [join(own) for own in zip(*described, strict=True)]


def _of_part(progress: Callable[[float], None], number: int, parts: int, share: float) -> None:
    progress((number + share) / parts)


def parts_of(model: AnyModel) -> tuple[FeaturePart, ...]:
    """Return the parts of the feature of a descriptor model."""
    return tuple(
        FeaturePart(one.kind, one.network, one.raw_dimensions, one.least_side)
        for one in model.parts
    )


def model_of_part(model: AnyModel, number: int) -> DescriptorModel:
    """Return the model of one part, which gets the images that it gets among all parts."""
    own = model.parts[number]
    return replace(own, mask=model.mask, view=model.view, least_side=model.least_side)


def least_side_for(sides: Sequence[int | None]) -> int | None:
    """Return the least side of an image that is enough for all parts; None: it is decoded whole."""
    known = [side for side in sides if side is not None]
    return max(known) if len(known) == len(sides) else None


def part_names(model: AnyModel) -> list[str]:
    """Return a name of each part: its kind, or for ``onnx:FOLDER/net.onnx`` ``net``.

    If two parts had one name, every name is the kind.
    """
    kinds = [part.kind for part in model.parts]
    short = [
        Path(kind.removeprefix(ONNX)).stem if kind.startswith(ONNX) else kind for kind in kinds
    ]
    return short if len(set(short)) == len(short) else kinds


def split_columns(vectors: NDArray[Real], widths: Sequence[int]) -> list[NDArray[Real]]:
    """Split vectors (..., D) into parts of these widths, (..., Dp), without copying them."""
    return np.split(vectors, np.cumsum(widths)[:-1], axis=-1)


def join(descriptors: Sequence[Array]) -> Array:
    """Join descriptors of P parts, (..., Np), to one (..., N), of unit length if they are."""
    scale = np.float32(1 / np.sqrt(len(descriptors)))
    return np.asarray(np.concatenate(descriptors, axis=-1) * scale, np.float32)
