"""Inference: the output of a network for an image, by onnxruntime."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from placefield.config import InferenceConfig
from placefield.errors import ConfigError, FrameError
from placefield.features.grid import grid_means
from placefield.features.images import check_pixels
from placefield.features.network import Network, NetworkInput
from placefield.features.onnx_session import open_session, reason_of

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

Array = NDArray[np.float32]
Pixels = NDArray[np.uint8]

_DEFAULTS = InferenceConfig()
_FLOATS = ("tensor(float)", "tensor(float16)", "tensor(double)")


class NetworkFeature:
    """A feature that is the output of a network for an image; threads may share it.

    On the CPU the values do not depend on the number of threads.
    """

    def __init__(self, name: str, network: Network, inference: InferenceConfig = _DEFAULTS) -> None:
        """Load a network.

        Args:
            name: of the network, used in messages.
            network: to load.
            inference: where it runs.

        Raises:
            ConfigError: see ``open_session``, or its input or output does not fit.
        """
        self._input = network.input
        self._session = open_session(name, network.onnx, inference)
        self._output = _output_name(name, self._session, network.input.output)
        self._fed = _input_name(name, self._session, network.input)
        self._shape = self._try_out(name)

    def describe(self, pixels: Pixels) -> Array:
        """Return the output for an image (H, W) or (H, W, 3) BGR, as one row: (D,) float32.

        Raises:
            FrameError: the pixels have another shape or dtype, the network fails on them, or its
                output is not finite or of another shape than for a black image.
        """
        blob = network_input(pixels, self._input)
        try:
            output = self._forward(blob)
        except Exception as error:  # onnxruntime's exceptions have no common class
            raise FrameError(f"the network fails on it: {reason_of(error)}") from None
        if output.shape != self._shape:
            raise FrameError(
                f"the network's output {self._output!r} for it has shape {output.shape}, not "
                f"{self._shape}"
            )
        grid = self._input.grid
        feature = (output if grid is None else grid_means(output[0], grid, grid)).ravel()
        if not np.isfinite(feature).all():
            raise FrameError(f"the network's output {self._output!r} for it is not finite")
        return feature

    def _forward(self, blob: Array) -> Array:
        return np.asarray(self._session.run([self._output], {self._fed: blob})[0], np.float32)

    def _try_out(self, name: str) -> tuple[int, ...]:
        """Describe a black image, so that a network that cannot work fails at the start."""
        wanted = self._input
        black = np.zeros((1, wanted.channels, wanted.height, wanted.width), np.float32)
        try:
            shape = self._forward(black).shape
        except Exception as error:
            raise ConfigError(
                f"{name}: does not run on {wanted.width}×{wanted.height} pixels: {reason_of(error)}"
            ) from None
        if wanted.grid is not None and (len(shape) != 4 or min(shape[2:]) < wanted.grid):
            raise ConfigError(
                f"{name}: output {self._output!r} of shape {shape} has no {wanted.grid}×"
                f"{wanted.grid} cells; leave grid out, or make it smaller"
            )
        return shape


def network_input(pixels: Pixels, wanted: NetworkInput) -> Array:
    """Return the network's input (1, C, height, width) float32 of (H, W) or (H, W, 3) BGR pixels.

    Grey is Rec. 601 luma, which networks are trained on.

    Raises:
        FrameError: the pixels have another shape or dtype.
    """
    check_pixels(pixels)
    size = (wanted.width, wanted.height)
    planes = _planes(cv2.resize(_coloured(pixels, wanted), size, interpolation=cv2.INTER_AREA))
    if wanted.colour == "rgb":
        planes = planes[::-1]
    values = planes.astype(np.float32) * np.float32(wanted.scale)
    mean, deviation = (
        np.reshape(np.asarray(of, np.float32), (-1, 1, 1)) for of in (wanted.mean, wanted.deviation)
    )
    return np.asarray(((values - mean) / deviation)[None], np.float32)


def _coloured(pixels: Pixels, wanted: NetworkInput) -> Pixels:
    """Return the pixels as grey (H, W), equalised where wanted, or as BGR (H, W, 3)."""
    if wanted.colour == "grey":
        luma = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
        return np.asarray(cv2.equalizeHist(luma) if wanted.equalise else luma, np.uint8)
    bgr = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR) if pixels.ndim == 2 else pixels
    return np.asarray(bgr, np.uint8)


def _planes(pixels: MatLike) -> Pixels:
    """Return the channels (C, H, W) of pixels (H, W) or (H, W, C)."""
    channels = pixels if pixels.ndim == 3 else pixels[..., None]
    return np.ascontiguousarray(channels.transpose(2, 0, 1), np.uint8)


def _output_name(name: str, session: InferenceSession, wanted: str | None) -> str:
    outputs = {output.name: output.type for output in session.get_outputs()}
    if wanted is None and len(outputs) == 1:
        (wanted,) = outputs
    if wanted is None or wanted not in outputs:
        asked = "output is not given" if wanted is None else f"there is no output {wanted!r}"
        raise ConfigError(f"{name}: {asked}; the network has {', '.join(map(repr, outputs))}")
    if outputs[wanted] not in _FLOATS:
        raise ConfigError(
            f"{name}: output {wanted!r} is {outputs[wanted]}; choose one that is a tensor of floats"
        )
    return wanted


def _input_name(name: str, session: InferenceSession, wanted: NetworkInput) -> str:
    """Return the name of the only input, if an image as the TOML describes fits it."""
    shape = [1, wanted.channels, wanted.height, wanted.width]
    inputs = session.get_inputs()
    if len(inputs) != 1 or not _accepts(inputs[0].type, inputs[0].shape, shape):
        declared = " and ".join(rendered(each.type, each.shape) for each in inputs)
        raise ConfigError(
            f"{name}: its input is {declared or 'nothing'}, not {rendered(_FLOATS[0], shape)} as "
            "its TOML says (image, channel, row, column)"
        )
    return str(inputs[0].name)


def _accepts(kind: str, axes: Sequence[object], shape: list[int]) -> bool:
    """Whether a tensor of this shape fits; an axis that has a name or nothing takes any length."""
    return (
        kind == _FLOATS[0]
        and len(axes) == len(shape)
        and all(
            axis == length or not isinstance(axis, int)
            for axis, length in zip(axes, shape, strict=True)
        )
    )


def rendered(kind: str, axes: Sequence[object]) -> str:
    """Return a tensor's type and the lengths of its axes; a free axis is a question mark."""
    return f"{kind} {' x '.join(str(axis) if isinstance(axis, int) else '?' for axis in axes)}"
