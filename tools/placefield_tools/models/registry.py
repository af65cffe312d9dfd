"""The registry of networks, ``models.toml``, read and checked."""

import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, model_validator

from placefield.errors import ConfigError
from placefield.features.network import NetworkInput


class Model(BaseModel):
    """A network that is known by name.

    Attributes:
        name: in commands.
        about: what it is.
        code_licence: as its authors state it; or that it is unknown.
        weights_licence: likewise.
        page: address of its page.
        dimension: of its raw feature.
        input: how an image becomes its input.
        url: address of its ONNX file; None if there is none whose checksum is known.
        bytes: length of that file.
        sha256: of that file.
        export: Python that makes it of the authors' code, an expression or lines that set
            ``network``, with ``torch`` imported; None if it is fetched.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    about: str
    code_licence: str
    weights_licence: str
    page: str
    dimension: int = Field(ge=1)
    input: NetworkInput
    url: str | None = None
    bytes: int | None = None
    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")] | None = None
    export: str | None = None

    @model_validator(mode="after")
    def _is_fetched_or_exported(self) -> Self:
        known = [self.url is not None, self.bytes is not None, self.sha256 is not None]
        if any(known) != all(known) or all(known) == (self.export is not None):
            raise ValueError("give url, bytes and sha256, or export")
        return self


@cache
def models() -> Mapping[str, Model]:
    """Return all networks of the registry, by name."""
    text = files(__package__).joinpath("models.toml").read_text(encoding="utf-8")
    return {
        name: Model.model_validate({"name": name, **entry})
        for name, entry in tomllib.loads(text).items()
    }


def model(name: str) -> Model:
    """Return a network by its name.

    Raises:
        ConfigError: there is no network of this name.
    """
    if name not in models():
        raise ConfigError(f"{name}: unknown model; 'placefield models' lists the names")
    return models()[name]
