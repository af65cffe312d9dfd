"""Fetching a network: it appears under its name only when it is complete and right."""

import os
import shutil
from pathlib import Path

import tomli_w

from placefield.errors import ConfigError, SourceError
from placefield.features.kinds import ONNX, kind_of, kinds_of
from placefield.files import write_whole
from placefield_tools.datasets.downloading import Progress, download
from placefield_tools.datasets.getting import alone, disk_errors_reported
from placefield_tools.datasets.sums import sum_of
from placefield_tools.models.registry import Model, models


def models_folder() -> Path:
    """Return the folder of fetched networks, of this user."""
    data = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(data) / "placefield" / "models"


def get(model: Model, folder: Path, progress: Progress) -> Path:
    """Fetch a network, check it, and write its TOML beside it; an interrupted fetch is resumed.

    Args:
        model: to fetch.
        folder: for NAME.onnx and NAME.toml.
        progress: called with the progress.

    Returns:
        The network's file.

    Raises:
        SourceError: the network cannot be fetched completely, its checksum is wrong, or the disk
            refuses.
        ConfigError: nothing is fetched for this network, because it must be exported.
    """
    if model.url is None:
        raise ConfigError(
            f"{model.name}: is exported by its authors' code; 'placefield models show "
            f"{model.name}' says how"
        )
    file = folder / f"{model.name}.onnx"
    if file.is_file():
        return file
    partial = folder / f"{model.name}.partial"
    with disk_errors_reported(partial):
        partial.mkdir(parents=True, exist_ok=True)
        with alone(partial):
            part = partial / file.name
            download(model.url, part, model.bytes, progress)
            if (found := sum_of(part)) != model.sha256:
                part.unlink()
                raise SourceError(
                    f"{model.url}: removed, its SHA-256 is {found} and not {model.sha256}"
                )
            write_whole(file.with_suffix(".toml"), toml_of(model).encode())
            part.rename(file)
            shutil.rmtree(partial)
    return file


def toml_of(model: Model) -> str:
    """Return what lies beside a network: how an image becomes its input."""
    return tomli_w.dumps(model.input.model_dump(mode="json", exclude_none=True))


def feature_named(kind: str) -> str:
    """Return the kind of feature of ``--feature``: the names of networks become their files.

    Raises:
        ConfigError: the network has not been fetched.
    """
    return kind_of(map(_part_named, kinds_of(kind)))


def _part_named(kind: str) -> str:
    if kind not in models():
        return kind
    file = models_folder() / f"{kind}.onnx"
    if not file.is_file():
        how = "get" if models()[kind].url is not None else "show"
        raise ConfigError(f"--feature {kind}: no {file}; see 'placefield models {how} {kind}'")
    return f"{ONNX}{file}"
