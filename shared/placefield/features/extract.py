"""Raw features of frames, by the kind of feature."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.config import InferenceConfig
from placefield.errors import FrameError
from placefield.features.calibration import View
from placefield.features.descriptors import unit_length
from placefield.features.frames import Frame, GivenDescriptor
from placefield.features.gist import gist
from placefield.features.grayscale import HEIGHT, WIDTH, grayscale
from placefield.features.images import pixels_of
from placefield.features.inference import NetworkFeature
from placefield.features.joined_model import AnyModel, FeaturePart, least_side_for
from placefield.features.kinds import DESCRIPTOR, ONNX, FeatureKind, kind_of, kinds_of
from placefield.features.mask import Mask
from placefield.features.network import Network, read_network
from placefield.features.network_sandbox import try_network
from placefield.features.rectification import image_of
from placefield.features.shrink import small_grey
from placefield.plugins import load_plugin

GIST_SIZE = 64  # pixels; 128 pixels were no better on the sample routes, and slower

# A JPEG that is decoded to a part of its size has lost where an edge lies within its pixels. Each
# pixel of a feature is the mean of 4 x 4 of them and more, so that this changes little. For GIST,
# a few less are enough, and 640 x 480 can be decoded to half its sides; see docs/performance.md.
_DECODED_PER_PIXEL = 4
_LEAST_SIDE_OF_GIST = 240

_DEFAULTS = InferenceConfig()
_ANY_IMAGE = np.zeros((64, 64, 3), np.uint8)

Array = NDArray[np.float32]
Pixels = NDArray[np.uint8]

Describe = Callable[[Sequence[Pixels]], Array]
"""The contract of a feature: B images (H, W) or (H, W, 3) BGR to their raw features (B, D)."""


@dataclass(frozen=True)
class DescribingPart:
    """What describes images by one part of a feature.

    Attributes:
        kind: of the part.
        network: the network that it runs; None if it needs none.
        describe: B images to their raw features (B, D).
        least_side: pixels that the shorter side of an image has at least if it is decoded to a part
            of its size; None: images are decoded whole.
    """

    kind: FeatureKind
    network: Network | None
    describe: Describe
    least_side: int | None = None


@dataclass(frozen=True)
class Feature:
    """A feature, which describes frames; threads may share it.

    The raw feature of several parts has those of all parts, one after the other, each divided by
    its length.

    Attributes:
        describing: its parts, one or more.
        mask: hides a part of each image first; None: nothing is hidden.
        view: that each frame is rectified to before; None: images are used as they are.
    """

    describing: tuple[DescribingPart, ...]
    mask: Mask | None = None
    view: View | None = None

    @property
    def kind(self) -> FeatureKind:
        """The kind of the feature."""
        return kind_of(part.kind for part in self.describing)

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """How many numbers of the raw feature each part has; an image is described to know them.

        Raises:
            FrameError: it describes no images.
        """
        return tuple(part.describe([_ANY_IMAGE]).shape[1] for part in self.describing)

    @cached_property
    def parts(self) -> tuple[FeaturePart, ...]:
        """Its parts, with their widths if there are several."""
        widths = (None,) if len(self.describing) == 1 else self.widths
        return tuple(
            FeaturePart(part.kind, part.network, width, part.least_side)
            for part, width in zip(self.describing, widths, strict=True)
        )

    @cached_property
    def least_side(self) -> int | None:
        """The least side of an image that is enough for all parts, see ``DescribingPart``."""
        return least_side_for([part.least_side for part in self.describing])

    @property
    def describes_images(self) -> bool:
        """Whether frames are images; if not, they are given descriptors."""
        return self.kind != DESCRIPTOR

    def describe(self, image: bytes | Pixels) -> Array:
        """Return the raw feature of an encoded image or of pixels, (D,) float32.

        If the feature has a view, the image is of this view.

        Raises:
            FrameError: the image cannot be read, or has another aspect ratio than the mask.
        """
        pixels = pixels_of(image, self.least_side)
        return self._joined(self._describe(pixels, range(len(self.describing))))

    def _describe(self, pixels: Pixels, numbers: Iterable[int]) -> dict[int, Array]:
        used = [self.used(pixels)]
        return {number: self.describing[number].describe(used)[0] for number in numbers}

    def _joined(self, described: Mapping[int, Array]) -> Array:
        rows = [described[number] for number in range(len(self.describing))]
        return rows[0] if len(rows) == 1 else np.concatenate(list(map(unit_length, rows)))

    def used(self, pixels: Pixels) -> Pixels:
        """Return an image without what the mask hides.

        Raises:
            FrameError: the image has another aspect ratio than the mask.
        """
        return pixels if self.mask is None else self.mask.apply(pixels)

    def accept(self, descriptor: GivenDescriptor) -> Array:
        """Return the raw feature of a frame that is a given descriptor: itself, (D,) float32.

        Raises:
            FrameError: the feature describes images.
        """
        if self.describes_images:
            raise FrameError(f"a descriptor, but {self.kind} describes images: give an image")
        return np.asarray(descriptor, np.float32)

    def observe(self, frame: Frame) -> tuple[Array, Pixels | None]:
        """Return the raw feature of a frame, (D,) float32, and the image that was described.

        The image may have been decoded to a part of its size, see ``image_of``. A frame that is a
        given descriptor has no image.

        Raises:
            FrameError: see ``of_frame``.
        """
        if frame.descriptor is None or frame.fault:
            image = image_of(frame, self.view, self.least_side)
            return self.describe(image), image
        return self.accept(frame.descriptor), None

    def of_frame(self, frame: Frame, described: Mapping[int, Array] | None = None) -> Array:
        """Return the raw feature of a frame, (D,) float32.

        Args:
            frame: an image or a given descriptor.
            described: the parts that are computed already, see ``parts_of_frame``. If they are all,
                the image is not read.

        Raises:
            FrameError: see ``image_of``; or it is a descriptor where the feature describes images,
                or the reverse.
        """
        if not described:
            return self.observe(frame)[0]
        missing = [each for each in range(len(self.describing)) if each not in described]
        return self._joined({**described, **self.parts_of_frame(frame, missing)})

    def parts_of_frame(self, frame: Frame, numbers: Sequence[int]) -> dict[int, Array]:
        """Return the raw features of some parts of a frame's image, (Dp,) float32, by number.

        Raises:
            FrameError: see ``image_of``.
        """
        if not numbers:
            return {}
        return self._describe(image_of(frame, self.view, self.least_side), numbers)


def feature_of(kind: FeatureKind, inference: InferenceConfig = _DEFAULTS) -> Feature:
    """Return the feature of a kind; for ``onnx:FILE``, the network and its TOML are read.

    A kind may have several parts, as ``gist+onnx:FILE``.

    Raises:
        ConfigError: a file of the network is missing or malformed, onnxruntime cannot run the
            network (see ``try_network``), or no installed package has a feature of this name.
    """
    return Feature(tuple(_new_part(part, inference) for part in kinds_of(kind)))


def feature_of_model(model: AnyModel, inference: InferenceConfig = _DEFAULTS) -> Feature:
    """Return the feature that a descriptor model was fitted on.

    Its network, mask and view, and the size at which images are decoded, are those of the model.

    Raises:
        ConfigError: onnxruntime cannot run the network (see ``try_network``), or the package with
            the feature is not installed.
    """
    parts = tuple(
        _part(part.kind, part.network, part.least_side, inference) for part in model.parts
    )
    return Feature(parts, model.mask, model.view)


def network_of(kind: FeatureKind) -> Network | None:
    """Read the network of a kind of one part; None for a kind without a network.

    Raises:
        ConfigError: a file of the network is missing or malformed.
    """
    return read_network(Path(kind.removeprefix(ONNX))) if kind.startswith(ONNX) else None


def least_side_of(kind: FeatureKind, network: Network | None) -> int | None:
    """Return the least side of an image that new maps of a kind of one part need.

    It is four times the longer side of the image that the feature makes of it, and a little less
    for GIST. Images are decoded whole, None, for a feature of another package, and for a network
    whose input is equalised, which makes small differences large.
    """
    if network is not None:
        side = max(network.input.width, network.input.height)
        return None if network.input.equalise else _DECODED_PER_PIXEL * side
    grayscale = _DECODED_PER_PIXEL * max(WIDTH, HEIGHT)
    return {"grayscale": grayscale, "gist": _LEAST_SIDE_OF_GIST}.get(kind)


def _new_part(kind: FeatureKind, inference: InferenceConfig) -> DescribingPart:
    network = network_of(kind)
    return _part(kind, network, least_side_of(kind, network), inference)


def _part(
    kind: FeatureKind, network: Network | None, least_side: int | None, inference: InferenceConfig
) -> DescribingPart:
    if network is not None:
        try_network(kind, network)
        run = NetworkFeature(kind, network, inference).describe
        return DescribingPart(kind, network, _one_by_one(run), least_side)
    built_in = {"grayscale": grayscale, "gist": _gist, DESCRIPTOR: _no_image}.get(kind)
    describe = _one_by_one(built_in) if built_in else _of_plugin(kind)
    return DescribingPart(kind, None, describe, least_side)


def _one_by_one(describe: Callable[[Pixels], Array]) -> Describe:
    """Return a feature of one image as one of several."""
    return lambda images: np.stack([describe(pixels) for pixels in images])


def _of_plugin(kind: FeatureKind) -> Describe:
    """Return a feature of another package, with a check of its vectors."""
    describe = load_plugin("placefield.features", kind)

    def checked(images: Sequence[Pixels]) -> Array:
        raws = np.asarray(describe(images), np.float32)
        if raws.ndim != 2 or len(raws) != len(images) or not raws.size:
            raise FrameError(
                f"feature {kind!r}: gives shape {raws.shape} for {len(images)} images; "
                "it must give (B, D)"
            )
        if not np.isfinite(raws).all():
            raise FrameError(f"feature {kind!r}: gives numbers that are not finite")
        return raws

    return checked


def _no_image(pixels: Pixels) -> Array:
    raise FrameError("an image, but the map is of descriptors: give a descriptor")


def _gist(pixels: Pixels) -> Array:
    # The whole image is used: the authors' code crops the centre, which loses the street's sides.
    return gist(small_grey(pixels, GIST_SIZE, GIST_SIZE))


def default_dimensions(kind: FeatureKind) -> int:
    """Return the default number of dimensions that PCA keeps of a kind of one part."""
    return 500 if kind == "grayscale" else 300
