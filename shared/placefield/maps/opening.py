"""Opening a map from disk: its files are checked, and large arrays are memory-mapped."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.features.descriptors import DescriptorModel
from placefield.features.network import Network
from placefield.maps.array_files import ArrayFile, ArrayHeader, open_inside
from placefield.maps.array_layout import (
    CHANNEL_FILES,
    COARSE_FILES,
    GRAPH_FILES,
    LOCAL_FEATURE_FILES,
    LOOK_TRAVERSE_FILES,
    MASK_FILES,
    MASK_FOLDER,
    METRIC_FILES,
    MODEL_FILES,
    NETWORK_FILES,
    PLACE_FILES,
    TRAVERSE_FILES,
    Layout,
    look_files,
)
from placefield.maps.checksums import checksum_of_opened
from placefield.maps.manifest import REBUILD, Manifest, read_identified
from placefield.maps.map import STEPS, Map, MapAlignment, MapChannel, MapMetric, Places, fingerprint
from placefield.maps.route_graph import NO_LINKS, RouteGraph, problem_of
from placefield.search.coarse import CoarseIndex
from placefield.search.looks import MOST_BIAS, Looks
from placefield.verification.local_features import LENGTH
from placefield.verification.place_features import PlaceFeatures, problem_with

if TYPE_CHECKING:  # a router has no OpenCV
    from placefield.features.mask import Mask

_QUICK = 2**28  # bytes: up to this length, a wrong checksum is reported before a wrong shape
# The longest file that is accepted; the largest files hold some kB per place.
_MOST_BYTES = 2**30
_MOST_BYTES_OF_A_PLACE = 2**16


def open_map(
    path: Path | str, channels: Collection[int] | None = None, *, lineage: str | None = None
) -> Map:
    """Open a map; large arrays are memory-mapped, so that all processes of a host share them.

    Args:
        path: of the map.
        channels: the channels that are read and checked now; None: all, and the identity. The
            others are read and checked at the first access, which may raise the same errors.
        lineage: the lineage that the map must have, see ``lineage_of``; None accepts any map.

    Raises:
        MapError: there is no map, it is of another format or lineage, or the checksum, dtype or
            shape of a file is wrong.
    """
    path = Path(path)
    manifest, found = read_identified(path, lineage)
    files = _Files(path, manifest)
    count = manifest.places
    sizes = {"K": count, "P": count if manifest.pose_frame else 0, "2": 2, "3": 3, "6": STEPS}
    mean, deviation, components = files.load("features", MODEL_FILES, sizes)
    model = DescriptorModel(
        manifest.features.kind,
        manifest.features.standardise,
        mean,
        deviation,
        components,
        manifest.variance_kept,
        manifest.features.plain_pca,
        _open_network(files),
        _open_mask(files),
    )
    if fingerprint(model) != manifest.model:
        raise MapError(f"{path}: its descriptor model is not the manifest's; {REBUILD}")
    places = Places(*files.load("places", PLACE_FILES, sizes))
    _check_travelled(path, places)
    _check_same(path, places.same)
    all_channels = _Channels(files, sizes)
    all_channels.open(channels or ())
    return Map(
        preset=manifest.preset,
        seed=manifest.seed,
        features=manifest.features,
        scales=manifest.scales,
        metric=manifest.metric,
        traverses=manifest.traverses,
        pose_frame=manifest.pose_frame,
        model=model,
        places=places,
        channels=tuple(all_channels) if channels is None else all_channels,
        graph=_open_graph(files),
        alignments=dict(_open_alignments(files)),
        local_features=_open_local_features(files),
        history=manifest.history,
        identity=all_channels.open_identity() if channels is None else None,
        digest=found,
        check_unchanged=files.check_unchanged,
    )


class _Files:
    """The arrays of a map's folder."""

    def __init__(self, path: Path, manifest: Manifest) -> None:
        self.path, self.manifest = path, manifest
        self._watched: list[tuple[Path, ArrayFile]] = []

    def load(self, folder: str, layout: Layout, sizes: dict[str, int]) -> list[NDArray[Any]]:
        """Load a folder's arrays. ``sizes`` holds the known lengths of axes; new ones are added."""
        arrays = []
        for name, (dtype, axes) in layout.items():
            arrays.append(self._open(f"{folder}/{name}.npy", dtype, axes, sizes))
        return arrays

    def _open(self, name: str, dtype: str, axes: str, sizes: dict[str, int]) -> NDArray[Any]:
        file = self.path / name
        try:
            content = open_inside(self.path, name)
            opened = ArrayFile(content)
            header = opened.header()
            problem = self._problem(opened, header, dtype, axes, sizes)
            if problem is not None and opened.length > _QUICK:
                raise MapError(f"{file}: {problem}; {REBUILD}")
            if checksum_of_opened(content) != self.manifest.files.get(name):
                raise MapError(f"{file}: damaged: its checksum is wrong; {REBUILD}")
            if header is None or problem is not None:
                raise MapError(f"{file}: {problem}; {REBUILD}")
            array = opened.array(header)
        except OSError:
            raise MapError(f"{file}: missing or unreadable; {REBUILD}") from None
        if opened.is_mapped:
            self._watched.append((file, opened))
        else:
            opened.close()
        return array

    def _problem(
        self,
        opened: ArrayFile,
        header: ArrayHeader | None,
        dtype: str,
        axes: str,
        sizes: dict[str, int],
    ) -> str | None:
        """Describe what is wrong with an array, by its header alone: the file may be huge."""
        if header is None:
            return "not an array"
        if header.dtype != dtype or not _fits(header.shape, axes, sizes):
            return "does not fit the other files"
        if opened.length > _MOST_BYTES + _MOST_BYTES_OF_A_PLACE * self.manifest.places:
            return "too long for so many places"
        return None

    def check_unchanged(self) -> None:
        """See ``Map.check_unchanged``."""
        for file, opened in self._watched:
            if not opened.is_unchanged:
                raise MapError(f"{file}: was written to while in use; {REBUILD}")


def _fits(shape: tuple[int, ...], axes: str, sizes: dict[str, int]) -> bool:
    return len(shape) == len(axes) and all(
        sizes.setdefault(axis, length) == length for axis, length in zip(axes, shape, strict=True)
    )


def _check_travelled(path: Path, places: Places) -> None:
    travelled = places.travelled
    is_complete = len(travelled) == places.count and np.isfinite(travelled).all()
    if len(travelled) and not (is_complete and (np.diff(travelled) >= 0).all()):
        file = path / "places" / "travelled.npy"
        raise MapError(f"{file}: not one ascending count of metres per place; {REBUILD}")


def _check_same(path: Path, same: NDArray[np.int32]) -> None:
    is_earlier = ((same >= 0) & (same <= np.arange(len(same)))).all()
    if not (is_earlier and (same[same] == same).all()):
        file = path / "places" / "same.npy"
        raise MapError(f"{file}: does not name the earliest same place of each; {REBUILD}")


def _check_looks(folder: Path, looks: Looks, traverses: int) -> None:
    places, biases = looks.places, looks.biases
    if places[0] < 0 or places[-1] >= len(biases) or (places[1:] < places[:-1]).any():
        file = folder / "places.npy"
        raise MapError(f"{file}: does not name places of the map in ascending order; {REBUILD}")
    if biases.min() < 0 or biases.max() > MOST_BIAS:
        raise MapError(f"{folder / 'biases.npy'}: no squared distances; {REBUILD}")
    of = looks.traverses
    if of is not None and not (of.min() > 0 and of.max() < traverses):
        file = folder / "traverses.npy"
        raise MapError(f"{file}: does not name further traverses of the map; {REBUILD}")


def _open_alignments(files: _Files) -> Iterator[tuple[int, MapAlignment]]:
    for number, record in enumerate(files.manifest.traverses):
        if record.aligned is None:
            continue
        folder = f"traverses/{number}"
        (places,) = files.load(folder, TRAVERSE_FILES, {"F": record.frames})
        is_place = (places >= -1) & (places < files.manifest.places)
        if not (is_place.all() and np.count_nonzero(places >= 0) == record.aligned):
            file = files.path / folder / "places.npy"
            raise MapError(
                f"{file}: does not fit the map's places or 'aligned' in its manifest; {REBUILD}"
            )
        yield number, MapAlignment(places)


def _open_graph(files: _Files) -> RouteGraph:
    manifest = files.manifest
    links = NO_LINKS
    if manifest.links:
        (links,) = files.load("graph", GRAPH_FILES, {"l": manifest.links, "2": 2})
    names = tuple(record.name for record in manifest.routes)
    counts = [record.places for record in manifest.routes]
    if not names:
        names, counts = tuple(each.name for each in manifest.traverses[:1]), [manifest.places]
    first = np.cumsum([0, *counts[:-1]], dtype=np.int32)
    first.setflags(write=False)
    graph = RouteGraph(names, first, links)
    problem = problem_of(graph, manifest.places)
    if sum(counts) != manifest.places:
        problem = "the routes have more or fewer places than the map"
    if problem is not None:
        raise MapError(f"{files.path}: routes and links: {problem}; {REBUILD}")
    return graph


def _open_local_features(files: _Files) -> PlaceFeatures | None:
    manifest = files.manifest
    if not manifest.local_features:
        return None
    sizes = {"K": manifest.places, "n": manifest.local_features, "2": 2, "B": LENGTH}
    found = PlaceFeatures(*files.load("local_features", LOCAL_FEATURE_FILES, sizes))
    if problem := problem_with(found):
        raise MapError(f"{files.path / 'local_features'}: {problem}; {REBUILD}")
    return found


def _open_network(files: _Files) -> Network | None:
    if files.manifest.network is None:
        return None
    return Network(files.manifest.network, *files.load("features", NETWORK_FILES, {}))


def _open_mask(files: _Files) -> Mask | None:
    """Open the mask of a map that has one."""
    if not any(name.startswith(f"{MASK_FOLDER}/") for name in files.manifest.files):
        return None
    from placefield.features.images import MAX_PIXELS
    from placefield.features.mask import Mask

    (used,) = files.load(MASK_FOLDER, MASK_FILES, {})
    if not 0 < used.size <= MAX_PIXELS or used.max() != 1:
        file = files.path / MASK_FOLDER / "used.npy"
        raise MapError(f"{file}: is no mask of 0 and 1; {REBUILD}")
    return Mask(used)


class _Channels(Sequence[MapChannel]):
    """The channels of a map, each opened at its first access."""

    def __init__(self, files: _Files, sizes: Mapping[str, int]) -> None:
        self._files, self._sizes = files, sizes
        self._manifest = files.manifest
        self._metrics: dict[int, MapMetric] = {}
        self._channels: dict[int, MapChannel] = {}

    def __len__(self) -> int:
        return len(self._manifest.channels)

    def open(self, numbers: Collection[int]) -> None:
        """Open the channels of these numbers that exist."""
        for number in set(numbers) & set(range(len(self))):
            self._channel(number)

    def open_identity(self) -> MapMetric | None:
        """Open the metric that is not learned; None if the map has none."""
        metrics = enumerate(self._manifest.metrics)
        number = next((number for number, record in metrics if not record.learned), None)
        return None if number is None else self._metric(number)

    @overload
    def __getitem__(self, index: int) -> MapChannel: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[MapChannel, ...]: ...
    def __getitem__(self, index: int | slice) -> MapChannel | tuple[MapChannel, ...]:
        chosen = range(len(self))[index]
        if isinstance(chosen, range):
            return tuple(map(self._channel, chosen))
        return self._channel(chosen)

    def _channel(self, number: int) -> MapChannel:
        if number not in self._channels:
            self._channels[number] = self._open_channel(number)
        return self._channels[number]

    def _metric(self, number: int) -> MapMetric:
        if number not in self._metrics:
            self._metrics[number] = self._open_metric(number)
        return self._metrics[number]

    def _open_metric(self, number: int) -> MapMetric:
        record, folder = self._manifest.metrics[number], f"metrics/{number}"
        sizes = dict(self._sizes)
        projection, places, squares, steps = self._files.load(folder, METRIC_FILES, sizes)
        if not (np.isfinite(projection).all() and np.isfinite(steps).all()):
            raise MapError(f"{self._files.path / folder}: not all is finite; {REBUILD}")
        sizes["V"] = sizes["M"] + 1
        coarse = None
        if record.coarse_unit is not None:
            axes, codes, spread = self._files.load(f"{folder}/coarse", COARSE_FILES, sizes)
            coarse = CoarseIndex(axes, codes, spread, record.coarse_unit)
        return MapMetric(
            record.learned,
            projection,
            record.unit,
            places,
            squares,
            steps,
            coarse,
            self._open_looks(f"{folder}/looks", coarse, sizes | {"L": record.looks}),
        )

    def _open_looks(
        self, folder: str, coarse: CoarseIndex | None, sizes: dict[str, int]
    ) -> Looks | None:
        if not sizes["L"]:
            return None
        looks = Looks(*self._files.load(folder, look_files(coarse), sizes))
        if f"{folder}/traverses.npy" in self._manifest.files:  # older maps are without
            (traverses,) = self._files.load(folder, LOOK_TRAVERSE_FILES, sizes)
            looks = replace(looks, traverses=traverses)
        _check_looks(self._files.path / folder, looks, len(self._manifest.traverses))
        return looks

    def _open_channel(self, number: int) -> MapChannel:
        record, folder = self._manifest.channels[number], f"channels/{number}"
        path, places = self._files.path, self._manifest.places
        if record.metric >= len(self._manifest.metrics):
            raise MapError(f"{path}: channel {number}: no metric {record.metric}; {REBUILD}")
        labels, segments, scales, curve = self._files.load(folder, CHANNEL_FILES, dict(self._sizes))
        smallest = self._manifest.smallest_scale
        if smallest > places:
            raise MapError(f"{path}: smallest scale {smallest}: beyond the route; {REBUILD}")
        if not len(scales) or np.any(np.diff(scales, prepend=0, append=places + 1) <= 0):
            file = path / folder / "scales.npy"
            raise MapError(f"{file}: do not ascend, or beyond the route; {REBUILD}")
        metric = self._metric(record.metric)
        return MapChannel(
            record.fuzzifier,
            record.clusters,
            metric,
            labels,
            segments,
            scales,
            smallest,
            curve,
            record.refusal,
        )
