"""The channels of a map on disk, and their metrics: each is opened at its first access."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import overload

import numpy as np

from placefield.errors import MapError
from placefield.maps.array_layout import (
    CHANNEL_FILES,
    COARSE_FILES,
    LIST_FILES,
    LOOK_TRAVERSE_FILES,
    METRIC_FILES,
    look_files,
)
from placefield.maps.manifest import REBUILD
from placefield.maps.map import MapChannel, MapMetric
from placefield.maps.map_files import MapFiles
from placefield.search.coarse import CoarseIndex
from placefield.search.inverted import InvertedLists
from placefield.search.looks import MOST_BIAS, Looks


class MapChannels(Sequence[MapChannel]):
    """The channels of a map, each opened at its first access."""

    def __init__(self, files: MapFiles, sizes: Mapping[str, int]) -> None:
        """Prepare to open channels; ``sizes`` holds the known lengths of axes."""
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
            lists = self._open_lists(f"{folder}/coarse/lists", sizes | {"L": record.looks})
            coarse = CoarseIndex(axes, codes, spread, record.coarse_unit, lists)
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

    def _open_lists(self, folder: str, sizes: dict[str, int]) -> InvertedLists | None:
        if f"{folder}/codes.npy" not in self._manifest.files:  # older maps are without
            return None
        lists = InvertedLists(
            *self._files.load(folder, LIST_FILES, sizes | {"c": sizes["K"] + sizes["L"]})
        )
        _check_lists(self._files.path / folder, lists, sizes["K"])
        return lists

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


def _check_lists(folder: Path, lists: InvertedLists, places: int) -> None:
    ends, of = lists.ends, lists.places
    if not len(ends) or ends[0] < 0 or (ends[1:] < ends[:-1]).any() or ends[-1] != len(of):
        raise MapError(f"{folder / 'ends.npy'}: does not divide its rows into lists; {REBUILD}")
    if of.min() < 0 or of.max() >= places:
        raise MapError(f"{folder / 'places.npy'}: does not name places of the map; {REBUILD}")


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
