"""A network in ONNX, and the description of its input.

The file ``net.toml`` beside ``net.onnx`` says how an image becomes the network's input.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from placefield.errors import ConfigError
from placefield.features.onnx_file import MOST_BYTES
from placefield.toml import parse_toml


class NetworkInput(BaseModel):
    """How an image becomes the input of a network, and which of its outputs is the feature.

    An image is resized to ``width`` × ``height``. Each value v, 0 to 255, becomes
    (``scale`` · v − ``mean``) / ``deviation``, where mean and deviation are one number each, or
    one number per channel.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    width: int = Field(ge=1, le=4096, description="pixels")
    height: int = Field(ge=1, le=4096, description="pixels")
    colour: Literal["rgb", "bgr", "grey"] = Field("rgb", description="order of the channels")
    equalise: bool = Field(False, description="equalise the histogram of a grey image first")
    scale: float = Field(1 / 255, gt=0, description="factor of a pixel's value, 0 to 255")
    mean: float | tuple[float, ...] = Field(0.0, description="subtracted from a scaled value")
    deviation: float | tuple[float, ...] = Field(1.0, description="divisor after that")
    output: str | None = Field(None, description="name of the output; needed if there are several")
    grid: int | None = Field(
        None, ge=1, description="average each channel over a grid of this many cells per side"
    )

    @property
    def channels(self) -> int:
        """1 for grey, else 3."""
        return 1 if self.colour == "grey" else 3

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name, value in (("mean", self.mean), ("deviation", self.deviation)):
            if isinstance(value, tuple) and len(value) != self.channels:
                raise ValueError(f"{name} has {len(value)} values for {self.channels} channels")
        if np.any(np.asarray(self.deviation) <= 0):
            raise ValueError("deviation must be above 0")
        if self.equalise and self.colour != "grey":
            raise ValueError('equalise is for colour = "grey"')
        return self


@dataclass(frozen=True)
class Network:
    """A network, as the bytes of its file.

    Attributes:
        input: description of its input.
        onnx: (bytes,) uint8, the file.
    """

    input: NetworkInput
    onnx: NDArray[np.uint8]

    def __repr__(self) -> str:
        return f"Network({self.input.width} × {self.input.height}, {len(self.onnx)} bytes)"

    @property
    def digest(self) -> bytes:
        """SHA-256 of the network and its input: equal digests give equal features."""
        digest = hashlib.sha256(self.input.model_dump_json().encode())
        digest.update(self.onnx.data)
        return digest.digest()


def read_network(path: Path) -> Network:
    """Read ``net.onnx``, and ``net.toml`` beside it.

    Raises:
        ConfigError: a file is missing or unreadable, or the TOML is malformed.
    """
    # The network first: if both files are missing, the error names the one that the user named.
    onnx = read_onnx(path)
    return Network(_read_input(path.with_suffix(".toml")), onnx)


def read_onnx(path: Path) -> NDArray[np.uint8]:
    """Read the file of a network: (bytes,) uint8.

    Raises:
        ConfigError: it is missing or unreadable.
    """
    return np.frombuffer(_read(path, "network"), np.uint8)


def _read(path: Path, what: str) -> bytes:
    try:
        with path.open("rb") as opened:  # one byte more, so that a longer file is refused later
            return opened.read(MOST_BYTES + 1)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such {what}") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None


def _read_input(path: Path) -> NetworkInput:
    text = _read(path, "file; it must describe the network's input: width, height, …")
    try:
        return NetworkInput.model_validate(parse_toml(text, str(path)))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the whole"
        raise ConfigError(f"{path}: {key}: {first['msg']}") from None
