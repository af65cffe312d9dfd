"""Inference: the output of a network for an image, by OpenCV."""

import re
import threading

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError
from placefield.features.grid import grid_means
from placefield.features.images import check_pixels
from placefield.features.network import Network, NetworkInput
from placefield.features.onnx_file import check_onnx

Array = NDArray[np.float32]
Pixels = NDArray[np.uint8]

# An input in OpenCV's dump of a network: its type, and the length of each axis, or the name of an
# axis of free length. OpenCV offers these nowhere else.
_DUMPED_INPUT = re.compile(r"<Input> (\w+) \[([^]]*)\]")


class NetworkFeature:
    """A feature that is the output of a network for an image.

    Threads may share it. A lock serialises them, because OpenCV's networks are not thread-safe;
    OpenCV uses all cores for each image. The values do not depend on the number of cores.
    """

    def __init__(self, name: str, network: Network) -> None:
        """Load a network.

        Args:
            name: of the network, used in messages.
            network: to load.

        Raises:
            ConfigError: the file is refused (see ``check_onnx``), OpenCV cannot run the network, or
                its input or output does not fit.
        """
        self._input = network.input
        self._lock = threading.Lock()
        self._net = _load(name, network)
        self._output = _output_name(name, self._net, network.input.output)
        _check_input(name, self._net, network.input)
        self._try_out(name)

    def describe(self, pixels: Pixels) -> Array:
        """Return the output for an image (H, W) or (H, W, 3) BGR, as one row: (D,) float32.

        Raises:
            FrameError: the pixels have another shape or dtype, the network fails on them, or its
                output is not finite.
        """
        try:
            output = self._forward(network_input(pixels, self._input))
        except cv2.error as error:
            raise FrameError(f"the network fails on it: {_reason(error)}") from None
        grid = self._input.grid
        feature = (output if grid is None else grid_means(output[0], grid, grid)).ravel()
        if not np.isfinite(feature).all():
            raise FrameError(f"the network's output {self._output!r} for it is not finite")
        return feature

    def _forward(self, blob: Array) -> Array:
        with self._lock:
            self._net.setInput(blob)
            # copied, because the network writes its next output into the same memory
            return np.array(self._net.forward(self._output), np.float32)

    def _try_out(self, name: str) -> None:
        """Describe a black image, so that a network that cannot work fails at the start."""
        wanted = self._input
        black = np.zeros((1, wanted.channels, wanted.height, wanted.width), np.float32)
        try:
            shape = self._forward(black).shape
        except cv2.error as error:
            raise ConfigError(
                f"{name}: does not run on {wanted.width}×{wanted.height} pixels: {_reason(error)}"
            ) from None
        if wanted.grid is not None and (len(shape) != 4 or min(shape[2:]) < wanted.grid):
            raise ConfigError(
                f"{name}: output {self._output!r} of shape {shape} has no {wanted.grid}×"
                f"{wanted.grid} cells; leave grid out, or make it smaller"
            )


def network_input(pixels: Pixels, wanted: NetworkInput) -> Array:
    """Return the network's input (1, C, height, width) float32 of (H, W) or (H, W, 3) BGR pixels.

    Grey is Rec. 601 luma, which networks are trained on.

    Raises:
        FrameError: the pixels have another shape or dtype.
    """
    check_pixels(pixels)
    coloured = _coloured(pixels, wanted)
    size = (wanted.width, wanted.height)
    resized = cv2.resize(coloured, size, interpolation=cv2.INTER_AREA)
    rows = resized.reshape(wanted.height, wanted.width, wanted.channels).astype(np.float32)
    mean, deviation = (np.asarray(of, np.float32) for of in (wanted.mean, wanted.deviation))
    normal = (rows * np.float32(wanted.scale) - mean) / deviation
    return np.ascontiguousarray(normal.transpose(2, 0, 1)[None], np.float32)


def _coloured(pixels: Pixels, wanted: NetworkInput) -> Pixels:
    if wanted.colour == "grey":
        luma = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
        return np.asarray(cv2.equalizeHist(luma) if wanted.equalise else luma, np.uint8)
    bgr = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR) if pixels.ndim == 2 else pixels
    return np.asarray(bgr if wanted.colour == "bgr" else bgr[..., ::-1], np.uint8)


def _load(name: str, network: Network) -> cv2.dnn.Net:
    check_onnx(name, network.onnx)
    try:
        return cv2.dnn.readNetFromONNX(network.onnx)
    except cv2.error as error:
        raise ConfigError(f"{name}: no network that OpenCV can run: {_reason(error)}") from None


def _output_name(name: str, net: cv2.dnn.Net, wanted: str | None) -> str:
    names = list(net.getUnconnectedOutLayersNames())
    if wanted is None and len(names) == 1:
        return names[0]
    if wanted not in names:
        asked = "output is not given" if wanted is None else f"there is no output {wanted!r}"
        raise ConfigError(f"{name}: {asked}; the network has {', '.join(map(repr, names))}")
    return wanted


def _check_input(name: str, net: cv2.dnn.Net, wanted: NetworkInput) -> None:
    """Refuse an input that the network does not declare: OpenCV would silently misread it."""
    shape = ["1", str(wanted.channels), str(wanted.height), str(wanted.width)]
    declared = _declared_inputs(net)
    if len(declared) != 1 or not _accepts(*declared[0], shape):
        expected = " and ".join(f"{kind} {' x '.join(axes)}" for kind, axes in declared)
        raise ConfigError(
            f"{name}: its input is {expected or 'nothing'}, not CV_32F {' x '.join(shape)} as its "
            "TOML says (image, channel, row, column)"
        )


def _declared_inputs(net: cv2.dnn.Net) -> list[tuple[str, list[str]]]:
    """Return the type and the lengths of the axes of each input; a free length is a ``?``."""
    inputs = _DUMPED_INPUT.findall(net.dump().split("outputs:")[0])
    return [
        (kind, [length if length.isdecimal() else "?" for length in axes.split(" x ")])
        for kind, axes in inputs
    ]


def _accepts(kind: str, axes: list[str], shape: list[str]) -> bool:
    return (
        kind.startswith("CV_32F")
        and len(axes) == len(shape)
        and all(axis in ("?", length) for axis, length in zip(axes, shape, strict=True))
    )


def _reason(error: cv2.error) -> str:
    """Return OpenCV's reason in one line, without the position in OpenCV's code."""
    return (error.err or str(error)).lstrip("> ").partition("\n")[0]
