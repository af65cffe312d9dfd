"""A map on disk: ``NAME.pfmap/`` with a manifest and ``.npy`` files, opened memory-mapped.

It is written beside its place and renamed, so that a build that is killed leaves no half map.
"""

import errno
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from placefield import __version__
from placefield.errors import MapError
from placefield.features.descriptors import DescriptorModel
from placefield.maps.manifest import ChannelRecord, Manifest
from placefield.maps.map import Map, MapChannel, Places, fingerprint

SUFFIX = ".pfmap"
MANIFEST = "manifest.json"

_REBUILD = "build the map again with 'placefield build'"
_MODEL_FILES = ("mean", "deviation", "components")
_PLACE_FILES = ("stamps", "poses", "thumbnails", "thumbnail_ends")
_CHANNEL_FILES = ("projection", "places", "labels", "segments", "scales", "curve")


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
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        what = "the disk is full; free some space" if full else (error.strerror or str(error))
        raise MapError(f"{path}: cannot write the map: {what}") from None


@contextmanager
def _written_beside(path: Path) -> Iterator[Path]:
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as temporary:
        folder = Path(temporary) / "new"
        folder.mkdir()
        yield folder
        if path.exists():
            path.rename(Path(temporary) / "old")
        folder.rename(path)


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
    parts: list[tuple[str, Any, tuple[str, ...]]] = [
        ("features", built.model, _MODEL_FILES),
        ("places", built.places, _PLACE_FILES),
    ]
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
        MapError: there is no map, it is of another format, or a file's checksum or shape is wrong.
    """
    manifest = read_manifest(path)
    model = DescriptorModel(
        manifest.features.kind,
        manifest.features.standardise,
        *_load(path, manifest, "features", _MODEL_FILES),
    )
    channels = tuple(
        MapChannel(
            record.fuzzifier,
            record.clusters,
            record.learned,
            *_load(path, manifest, f"channels/{number}", _CHANNEL_FILES),
        )
        for number, record in enumerate(manifest.channels)
    )
    opened = Map(
        seed=manifest.seed,
        features=manifest.features,
        scales=manifest.scales,
        metric=manifest.metric,
        traverses=manifest.traverses,
        pose_frame=manifest.pose_frame,
        model=model,
        places=Places(*_load(path, manifest, "places", _PLACE_FILES)),
        channels=channels,
    )
    _check_shapes(opened, manifest, path)
    return opened


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
    path: Path, manifest: Manifest, folder: str, names: tuple[str, ...]
) -> list[NDArray[Any]]:
    arrays = []
    for name in names:
        file = path / folder / f"{name}.npy"
        try:
            if _sha256(file) != manifest.files.get(f"{folder}/{name}.npy"):
                raise MapError(f"{file}: damaged: its checksum is wrong; {_REBUILD}")
            arrays.append(np.load(file, mmap_mode="r", allow_pickle=False))
        except OSError:
            raise MapError(f"{file}: missing or unreadable; {_REBUILD}") from None
        except ValueError:
            raise MapError(f"{file}: not an array; {_REBUILD}") from None
    return arrays


def _sha256(file: Path) -> str:
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _check_shapes(opened: Map, manifest: Manifest, path: Path) -> None:
    """Check that the arrays fit each other: a manifest edited by hand passes the checksums."""
    places, dimensions = manifest.places, len(opened.model.components)
    raw = opened.model.mean.shape
    fits = {
        "features/deviation": opened.model.deviation.shape == raw,
        "features/components": opened.model.components.shape[1:] == raw,
        "places/stamps": opened.places.stamps.shape == (places,),
        "places/poses": opened.places.poses.shape in ((places, 3), (0, 3)),
        "places/thumbnail_ends": opened.places.thumbnail_ends.shape == (places,),
    }
    for number, channel in enumerate(opened.channels):
        square = (dimensions, dimensions)
        fits[f"channels/{number}/projection"] = channel.projection.shape == square
        fits[f"channels/{number}/places"] = channel.places.shape == (places, dimensions)
        fits[f"channels/{number}/labels"] = channel.labels.shape == (places,)
        fits[f"channels/{number}/scales"] = len(channel.scales) > 0
    for name, fit in fits.items():
        if not fit:
            raise MapError(f"{path / name}.npy: does not fit the other files; {_REBUILD}")
    if fingerprint(opened.model) != manifest.model:
        raise MapError(f"{path}: its descriptor model is not the manifest's; {_REBUILD}")
