"""Local features by a network in ONNX, as exported ALIKED, DISK and SuperPoint give them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.config import InferenceConfig
from placefield.errors import ConfigError, FrameError
from placefield.features.images import check_pixels
from placefield.features.inference import network_input, rendered
from placefield.features.network import NetworkInput
from placefield.features.network_sandbox import answer_trial, run_trial
from placefield.features.onnx_session import open_session, reason_of
from placefield.verification.local_features import MOST_NUMBERS, NO_FEATURES, SIDE, LocalFeatures

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

Array = NDArray[np.float32]
Pixels = NDArray[np.uint8]

_MULTIPLE = 32  # pixels: networks halve their input five times at most
_LONGEST = 4096  # pixels of a side
_OUTSIDE = 1.0  # pixels that a keypoint may lie outside of the image
_DEFAULTS = InferenceConfig()


class LocalNetwork:
    """A network that gives the local features of an image; threads may share it.

    Its input is an image (1, 1, H, W), grey, or (1, 3, H, W), RGB, of values from 0 to 1. H and W
    are fixed or free. Its outputs are keypoints (n, 2), x and y in pixels, their scores (n,) and
    their descriptors (n, D), each also with one axis of length 1 before. If all of an image's
    keypoints are from -1 to 1, they are fractions of half the image, from its middle.

    Attributes:
        onnx: (bytes,) uint8, the file of the network.
        numbers: D.
    """

    def __init__(
        self, name: str, onnx: NDArray[np.uint8], inference: InferenceConfig = _DEFAULTS
    ) -> None:
        """Load a network.

        Args:
            name: of the network, used in messages.
            onnx: (bytes,) its file.
            inference: where it runs.

        Raises:
            ConfigError: see ``open_session``; or its input or outputs do not fit.
        """
        self.onnx = onnx
        self._session = open_session(name, onnx, inference)
        self._input = _input_of(name, self._session)
        self._outputs = _outputs_of(name, self._session)
        try:
            self.numbers = self._detect(_noise()).descriptors.shape[1]
        except Exception as error:  # onnxruntime's exceptions have no common class
            raise ConfigError(f"{name}: gives no local features: {reason_of(error)}") from None

    def extract(self, pixels: Pixels, count: int) -> LocalFeatures:
        """Return the local features of the highest scores of an image, ``count`` at most.

        Args:
            pixels: (H, W) grey or (H, W, 3) BGR, uint8.
            count: the most of them.

        Raises:
            FrameError: the pixels are of another shape or dtype, the network fails on them, or its
                outputs do not fit.
        """
        check_pixels(pixels)
        try:
            found = self._detect(pixels)
            if found.descriptors.shape[1] != self.numbers:
                raise ValueError(f"descriptors of shape {found.descriptors.shape}")
        except Exception as error:
            raise FrameError(f"the network of local features fails: {reason_of(error)}") from None
        strongest = np.argsort(-found.scores, kind="stable")[:count]
        if not len(strongest):
            return NO_FEATURES
        return LocalFeatures(found.points[strongest], as_bytes(found.descriptors[strongest]))

    def _detect(self, pixels: Pixels) -> _Detected:
        height, width = pixels.shape[:2]
        wanted = self._input.for_image(width, height)
        blob = network_input(pixels, wanted)
        outputs = self._session.run(self._outputs, {self._input.name: blob})
        keypoints, scores, descriptors = map(_without_batch, outputs, _AXES.values())
        _check(keypoints, scores, descriptors)
        size = np.array([wanted.width, wanted.height], np.float32)
        shares = np.array([width, height], np.float32) / max(width, height)
        points = np.asarray(_from_middle(keypoints, size) / size * shares, np.float32)
        return _Detected(points, scores, descriptors)


class _Detected(NamedTuple):
    """Local features of an image: points as ``LocalFeatures`` has them, the rest as given."""

    points: Array
    scores: Array
    descriptors: Array


class _Input(NamedTuple):
    """The input of a network; an axis is None if its length is free."""

    name: str
    channels: int
    height: int | None
    width: int | None

    def for_image(self, width: int, height: int) -> NetworkInput:
        """Return the input for an image of a size; free axes are near those of ``SIDE``."""
        longest = max(width, height)
        return NetworkInput(
            width=self.width or _rounded(SIDE * width / longest),
            height=self.height or _rounded(SIDE * height / longest),
            colour="grey" if self.channels == 1 else "rgb",
        )


_Role = Literal["keypoint", "score", "desc"]
"""An output, and what its name contains."""

_AXES: dict[_Role, int] = {"keypoint": 2, "score": 1, "desc": 2}


def try_local_network(name: str, onnx: NDArray[np.uint8]) -> None:
    """Load a network and run it on noise and on a blank image, in a separate process.

    Raises:
        ConfigError: ``LocalNetwork`` refuses the network, or see ``run_trial``.
    """
    run_trial(__name__, name, onnx)


def as_bytes(descriptors: Array) -> NDArray[np.uint8]:
    """Return descriptors (n, D) at unit length as (n, D) uint8, 128 for 0.

    Distances stay as they are, but for one factor and for rounding. The largest byte stands for 1,
    and with more than 64 numbers for eight standard deviations of a number: 8/√D.
    """
    values = descriptors.astype(np.float64)
    lengths = np.linalg.norm(values, axis=1, keepdims=True)
    unit = 127 * max(1, math.sqrt(descriptors.shape[1]) / 8)
    rounded = np.rint(unit * values / np.maximum(lengths, np.finfo(np.float64).tiny))
    return np.asarray(np.clip(rounded + 128, 0, 255), np.uint8)


def _check(keypoints: Array, scores: Array, descriptors: Array) -> None:
    """Raise ``ValueError`` if outputs without the axis of the image are not local features."""
    if keypoints.shape[1] != 2 or not len(keypoints) == len(scores) == len(descriptors):
        raise ValueError(
            f"keypoints of shape {keypoints.shape}, scores of {scores.shape} and descriptors of "
            f"{descriptors.shape}"
        )
    if not 0 < descriptors.shape[1] <= MOST_NUMBERS:
        raise ValueError(f"descriptors of {descriptors.shape[1]} numbers, not 1 to {MOST_NUMBERS}")
    if not all(np.isfinite(values).all() for values in (keypoints, scores, descriptors)):
        raise ValueError("an output is not finite")


def _from_middle(keypoints: Array, size: Array) -> Array:
    """Return keypoints (n, 2) in pixels from the middle of an image of this width and height."""
    middle = np.asarray((size - 1) / 2, np.float32)
    is_normalised = np.abs(keypoints).max(initial=0) <= 1
    points = keypoints * middle if is_normalised else keypoints - middle
    if (np.abs(points) > middle + _OUTSIDE).any():
        raise ValueError("a keypoint lies outside of the image")
    return np.asarray(points, np.float32)


def _without_batch(output: object, axes: int) -> Array:
    """Return an output without the axis of the image."""
    values = np.asarray(output, np.float32)
    if values.ndim == axes + 1 and len(values) == 1:
        values = values[0]
    if values.ndim != axes:
        raise ValueError(f"an output of shape {values.shape}, which has not {axes} axes")
    return values


def _rounded(pixels: float) -> int:
    return max(1, round(pixels / _MULTIPLE)) * _MULTIPLE


def _noise() -> Pixels:
    return np.random.default_rng(0).integers(0, 256, (SIDE, SIDE, 3), np.uint8)


def _input_of(name: str, session: InferenceSession) -> _Input:
    inputs = session.get_inputs()
    axes = inputs[0].shape if len(inputs) == 1 else []
    lengths = [axis if isinstance(axis, int) else None for axis in axes]
    if (
        len(lengths) != 4
        or inputs[0].type != "tensor(float)"
        or lengths[0] not in (1, None)
        or lengths[1] not in (1, 3)
        or any(length is not None and not 0 < length <= _LONGEST for length in lengths[2:])
    ):
        declared = " and ".join(rendered(each.type, each.shape) for each in inputs)
        raise ConfigError(
            f"{name}: its input is {declared or 'nothing'}, not tensor(float) 1 x 1 x ? x ? or "
            "1 x 3 x ? x ? (image, channel, row, column)"
        )
    return _Input(inputs[0].name, lengths[1], *lengths[2:])


def _outputs_of(name: str, session: InferenceSession) -> list[str]:
    """Return the names of the keypoints, scores and descriptors among a network's outputs."""
    left = {output.name: output.shape for output in session.get_outputs()}
    fits: dict[_Role, Callable[[Sequence[object]], bool]] = {
        "keypoint": lambda axes: len(axes) == 2 and axes[1] == 2,
        "desc": lambda axes: len(axes) == 2 and axes[1] != 2,
        "score": lambda axes: len(axes) == 1,
    }
    found: dict[_Role, str] = {}
    for role, is_fitting in fits.items():
        named = [output for output in left if role in output.lower()]
        fitting = [output for output in named or left if is_fitting(_axes(left[output]))]
        chosen = named if len(named) == 1 else fitting
        if len(chosen) != 1:
            given = ", ".join(repr(output) for output in left)
            raise ConfigError(
                f"{name}: gives no local features: which of its outputs are keypoints, scores and "
                f"descriptors is not clear; name them so, and not {given}"
            )
        found[role] = chosen[0]
        del left[chosen[0]]
    return [found[role] for role in _AXES]


def _axes(declared: Sequence[object]) -> Sequence[object]:
    """Return the declared axes of an output without the axis of the image."""
    has_batch = len(declared) == 3 or (len(declared) == 2 and declared[0] == 1)
    return declared[1:] if has_batch else declared


def _run(name: str, onnx: NDArray[np.uint8], wanted: str) -> None:
    network = LocalNetwork(name, onnx)
    with suppress(FrameError):  # an image without keypoints may take another path
        network.extract(np.zeros((SIDE, SIDE, 3), np.uint8), 1)


if __name__ == "__main__":
    answer_trial(_run)
