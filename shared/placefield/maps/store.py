"""A map on disk: ``NAME.pfmap/`` with a manifest and ``.npy`` files, opened memory-mapped.

It is written beside its place and renamed, so that a build that is killed leaves no half map.
"""

import errno
import hashlib
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from placefield import __version__
from placefield.errors import MapError
from placefield.features.descriptors import DescriptorModel
from placefield.features.network import Network
from placefield.maps.manifest import ChannelRecord, Manifest
from placefield.maps.map import Map, MapChannel, Places, fingerprint

SUFFIX = ".pfmap"
MANIFEST = "manifest.json"

_REBUILD = "build the map again with 'placefield build'"

# The arrays of each folder, by their file: dtype and axes. An axis of one letter has one length in
# all files of a folder; K places, P poses, N descriptor and D raw dimensions in the whole map.
_Layout = Mapping[str, tuple[str, str]]
_MODEL_FILES: _Layout = {
    "mean": ("float32", "D"),
    "deviation": ("float32", "D"),
    "components": ("float32", "ND"),
}
_NETWORK_FILES: _Layout = {"onnx": ("uint8", "o")}
_PLACE_FILES: _Layout = {
    "stamps": ("int64", "K"),
    "poses": ("float64", "P3"),
    "thumbnails": ("uint8", "b"),
    "thumbnail_ends": ("int64", "K"),
}
_CHANNEL_FILES: _Layout = {
    "projection": ("float32", "NN"),
    "places": ("float32", "KN"),
    "labels": ("int32", "K"),
    "segments": ("int32", "s2"),
    "scales": ("int32", "n"),
    "curve": ("float64", "t2"),
}


def check_map_path(path: Path) -> None:
    """Refuse what cannot become a map, before the work of building it.

    Raises:
        MapError: the path is no ``.pfmap``, or holds something else.
    """
    if path.suffix != SUFFIX:
        raise MapError(f"{path}: a map's name ends in {SUFFIX}")
    if path.exists() and not (path / MANIFEST).is_file():
        raise MapError(f"{path}: exists and is no map; remove it or choose another name")


def save_map(built: Map, path: Path) -> None:
    """Write a map; one that is already there is replaced at the end.

    Raises:
        MapError: see ``check_map_path``, or the map cannot be written.
    """
    check_map_path(path)
    try:
        with _written_beside(path) as folder:
            _write(built, folder)
    except OSError as error:
        # numpy tells of an array that was written in part without an errno
        full = error.errno in (None, errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        what = "the disk is full; free some space" if full else (error.strerror or str(error))
        raise MapError(f"{path}: cannot write the map: {what}") from None


@contextmanager
def _written_beside(path: Path) -> Iterator[Path]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as temporary:
        folder = Path(temporary) / "new"
        folder.mkdir()
        yield folder
        _put_in_place(folder, path, Path(temporary) / "old")


def _put_in_place(folder: Path, path: Path, old: Path) -> None:
    if not path.exists():
        folder.rename(path)
        return
    path.rename(old)
    try:
        folder.rename(path)
    except OSError:
        old.rename(path)
        raise


def _write(built: Map, folder: Path) -> None:
    files = {}
    for name, array in _arrays(built).items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        np.save(file, array, allow_pickle=False)
        files[name] = _sha256(file)
    manifest = Manifest(
        placefield=__version__,
        seed=built.seed,
        features=built.features,
        scales=built.scales,
        metric=built.metric,
        model=fingerprint(built.model),
        network=built.model.network.input if built.model.network else None,
        places=built.places.count,
        pose_frame=built.pose_frame,
        traverses=built.traverses,
        channels=tuple(
            ChannelRecord(fuzzifier=c.fuzzifier, clusters=c.clusters, learned=c.learned)
            for c in built.channels
        ),
        files=files,
    )
    with (folder / MANIFEST).open("w") as opened:
        opened.write(manifest.model_dump_json(indent=1))
        opened.flush()
        os.fsync(opened.fileno())


def _arrays(built: Map) -> dict[str, NDArray[Any]]:
    parts: list[tuple[str, Any, _Layout]] = [
        ("features", built.model, _MODEL_FILES),
        ("places", built.places, _PLACE_FILES),
    ]
    if built.model.network is not None:
        parts.append(("features", built.model.network, _NETWORK_FILES))
    for number, channel in enumerate(built.channels):
        parts.append((f"channels/{number}", channel, _CHANNEL_FILES))
    return {
        f"{folder}/{name}.npy": getattr(part, name)
        for folder, part, names in parts
        for name in names
    }


def open_map(path: Path) -> Map:
    """Open a map; its arrays are memory-mapped, so that all processes of a host share them.

    Raises:
        MapError: there is no map, it is of another format, or a file's checksum, dtype or shape is
            wrong.
    """
    manifest = read_manifest(path)
    places = manifest.places
    sizes = {"K": places, "P": places if manifest.pose_frame else 0, "2": 2, "3": 3}
    mean, deviation, components = _load(path, manifest, "features", _MODEL_FILES, sizes)
    model = DescriptorModel(
        manifest.features.kind,
        manifest.features.standardise,
        mean,
        deviation,
        components,
        _open_network(path, manifest),
    )
    if fingerprint(model) != manifest.model:
        raise MapError(f"{path}: its descriptor model is not the manifest's; {_REBUILD}")
    return Map(
        seed=manifest.seed,
        features=manifest.features,
        scales=manifest.scales,
        metric=manifest.metric,
        traverses=manifest.traverses,
        pose_frame=manifest.pose_frame,
        model=model,
        places=Places(*_load(path, manifest, "places", _PLACE_FILES, sizes)),
        channels=tuple(
            _open_channel(path, manifest, number, dict(sizes))
            for number in range(len(manifest.channels))
        ),
    )


def _open_network(path: Path, manifest: Manifest) -> Network | None:
    if manifest.network is None:
        return None
    return Network(manifest.network, *_load(path, manifest, "features", _NETWORK_FILES, {}))


def _open_channel(path: Path, manifest: Manifest, number: int, sizes: dict[str, int]) -> MapChannel:
    record, folder = manifest.channels[number], f"channels/{number}"
    channel = MapChannel(
        record.fuzzifier,
        record.clusters,
        record.learned,
        *_load(path, manifest, folder, _CHANNEL_FILES, sizes),
    )
    if not len(channel.scales) or np.any(np.diff(channel.scales, prepend=0) <= 0):
        raise MapError(f"{path / folder / 'scales.npy'}: do not ascend from 1 on; {_REBUILD}")
    return channel


def read_manifest(path: Path) -> Manifest:
    """Read a map's manifest.

    Raises:
        MapError: there is none, or it is of another format.
    """
    try:
        return Manifest.model_validate_json((path / MANIFEST).read_bytes())
    except OSError:
        raise MapError(f"{path}: no map there; {_REBUILD}") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the whole"
        raise MapError(f"{path / MANIFEST}: {key}: {first['msg']}; {_REBUILD}") from None


def _load(
    path: Path, manifest: Manifest, folder: str, layout: _Layout, sizes: dict[str, int]
) -> list[NDArray[Any]]:
    """Load a folder's arrays; ``sizes`` has the lengths of the axes known, and learns new ones."""
    arrays = []
    for name, (dtype, axes) in layout.items():
        file = path / folder / f"{name}.npy"
        array = _open_array(file, manifest.files.get(f"{folder}/{name}.npy"))
        if array.dtype != dtype or not _fits(array.shape, axes, sizes):
            raise MapError(f"{file}: does not fit the other files; {_REBUILD}")
        arrays.append(array)
    return arrays


def _open_array(file: Path, checksum: str | None) -> NDArray[Any]:
    try:
        if _sha256(file) != checksum:
            raise MapError(f"{file}: damaged: its checksum is wrong; {_REBUILD}")
        return np.lib.format.open_memmap(file, mode="r")
    except OSError:
        raise MapError(f"{file}: missing or unreadable; {_REBUILD}") from None
    except ValueError:
        raise MapError(f"{file}: not an array; {_REBUILD}") from None


def _fits(shape: tuple[int, ...], axes: str, sizes: dict[str, int]) -> bool:
    return len(shape) == len(axes) and all(
        sizes.setdefault(axis, length) == length for axis, length in zip(axes, shape, strict=True)
    )


def _sha256(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
