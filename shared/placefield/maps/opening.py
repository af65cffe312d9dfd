"""Opening a map: its arrays are memory-mapped, and what does not fit is refused."""

from collections.abc import Collection, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from placefield.errors import MapError
from placefield.features.descriptors import DescriptorModel
from placefield.features.network import Network
from placefield.maps.layout import (
    CHANNEL_FILES,
    COARSE_FILES,
    METRIC_FILES,
    MODEL_FILES,
    NETWORK_FILES,
    PLACE_FILES,
    Layout,
    sha256_of,
)
from placefield.maps.manifest import MANIFEST, Manifest
from placefield.maps.map import Map, MapChannel, MapMetric, Places, fingerprint
from placefield.metric.coarse import Coarse

_REBUILD = "build the map again with 'placefield build'"


def open_map(path: Path, channels: Collection[int] | None = None) -> Map:
    """Open a map; its arrays are memory-mapped, so that all processes of a host share them.

    Args:
        path: of the map.
        channels: that are read and checked now, None for all; another one is when it is first asked
            for, which may then raise what is below.

    Raises:
        MapError: there is no map, it is of another format, or a file's checksum, dtype or shape is
            wrong.
    """
    manifest = read_manifest(path)
    count = manifest.places
    sizes = {"K": count, "P": count if manifest.pose_frame else 0, "2": 2, "3": 3}
    mean, deviation, components = _load(path, manifest, "features", MODEL_FILES, sizes)
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
    places = Places(*_load(path, manifest, "places", PLACE_FILES, sizes))
    all_channels = _Channels(path, manifest, sizes)
    all_channels.open(channels or ())
    return Map(
        seed=manifest.seed,
        features=manifest.features,
        scales=manifest.scales,
        metric=manifest.metric,
        traverses=manifest.traverses,
        pose_frame=manifest.pose_frame,
        model=model,
        places=places,
        channels=tuple(all_channels) if channels is None else all_channels,
    )


def _open_network(path: Path, manifest: Manifest) -> Network | None:
    if manifest.network is None:
        return None
    return Network(manifest.network, *_load(path, manifest, "features", NETWORK_FILES, {}))


class _Channels(Sequence[MapChannel]):
    """The channels of a map, each opened when it is first asked for."""

    def __init__(self, path: Path, manifest: Manifest, sizes: Mapping[str, int]) -> None:
        self._path, self._manifest, self._sizes = path, manifest, sizes
        self._metric = cache(self._open_metric)
        self._channel = cache(self._open_channel)

    def __len__(self) -> int:
        return len(self._manifest.channels)

    def open(self, numbers: Collection[int]) -> None:
        """Open those of these that there are."""
        for number in set(numbers) & set(range(len(self))):
            self._channel(number)

    @overload
    def __getitem__(self, index: int) -> MapChannel: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[MapChannel, ...]: ...
    def __getitem__(self, index: int | slice) -> MapChannel | tuple[MapChannel, ...]:
        chosen = range(len(self))[index]
        if isinstance(chosen, range):
            return tuple(map(self._channel, chosen))
        return self._channel(chosen)

    def _open_metric(self, number: int) -> MapMetric:
        record, folder = self._manifest.metrics[number], f"metrics/{number}"
        sizes = dict(self._sizes)
        projection, places, squares, steps = self._load(folder, METRIC_FILES, sizes)
        coarse = None
        if record.coarse_unit is not None:
            axes, codes, spread = self._load(f"{folder}/coarse", COARSE_FILES, sizes)
            coarse = Coarse(axes, codes, spread, record.coarse_unit)
        return MapMetric(record.learned, projection, record.unit, places, squares, steps, coarse)

    def _open_channel(self, number: int) -> MapChannel:
        record, folder = self._manifest.channels[number], f"channels/{number}"
        if record.metric >= len(self._manifest.metrics):
            raise MapError(f"{self._path}: channel {number}: no metric {record.metric}; {_REBUILD}")
        labels, segments, scales, curve = self._load(folder, CHANNEL_FILES, dict(self._sizes))
        if not len(scales) or np.any(np.diff(scales, prepend=0) <= 0):
            raise MapError(f"{self._path / folder / 'scales.npy'}: do not ascend; {_REBUILD}")
        metric = self._metric(record.metric)
        return MapChannel(
            record.fuzzifier, record.clusters, metric, labels, segments, scales, curve
        )

    def _load(self, folder: str, layout: Layout, sizes: dict[str, int]) -> list[NDArray[Any]]:
        return _load(self._path, self._manifest, folder, layout, sizes)


def read_manifest(path: Path) -> Manifest:
    """Read a map's manifest.

    Raises:
        MapError: there is none, or it is of another format.
    """
    try:
        manifest = Manifest.model_validate_json((path / MANIFEST).read_bytes())
    except OSError:
        raise MapError(f"{path}: no map there; {_REBUILD}") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"]) or "the whole"
        raise MapError(f"{path / MANIFEST}: {key}: {first['msg']}; {_REBUILD}") from None
    if manifest != manifest.sealed():
        raise MapError(f"{path / MANIFEST}: damaged: its checksum is wrong; {_REBUILD}")
    return manifest


def _load(
    path: Path, manifest: Manifest, folder: str, layout: Layout, sizes: dict[str, int]
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
        if sha256_of(file) != checksum:
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
