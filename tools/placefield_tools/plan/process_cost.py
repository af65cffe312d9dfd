"""What the processes of a run cost: seconds of a core per frame, and memory.

The cost of a frame for a channel worker is what it reads under each metric: the places, or a few
bytes of each place if the map has a coarse search, and the beliefs. Shards divide this cost. With
inverted lists, a whole channel costs the same on a map of any size, and a shard as without them.

The constants were measured on the machine of docs/performance.md, for the rule ``filter``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from placefield.errors import MapError
from placefield.features.kinds import DESCRIPTOR, kinds_of
from placefield.maps.array_layout import COARSE_FILES, LIST_FILES, METRIC_FILES, look_files
from placefield.maps.manifest import REBUILD, Manifest

# Seconds of one core per frame.
FEATURIZER_S = {"gist": 5.3e-3, "grayscale": 3.5e-3, DESCRIPTOR: 1.0e-3}
"""Seconds of a featurizer by its feature; networks take longer."""
_NETWORK_S = 30e-3  # a small one
_FUSER_S = 2.1e-3
_ROUTER_S = 1.3e-3
_WORKER_S = 1.2e-3  # to wake up, and to answer
_SHARD_S = 1.0e-3  # additional, to exchange partial results with the other shards
_READ_S = 1 / 15e9  # per byte of places or of a projection
_FILTER_S = 80e-9  # per place under a metric: predict and update its beliefs
_SPARSE_S = 4e-3  # per metric with inverted lists: what the lists propose, and its beliefs

_PROCESS_BYTES = 120_000_000  # Python and its libraries
_BELIEFS_BYTES = 560  # per place under a metric: beliefs, likelihoods, and what a step needs
_LOOKED_AT = 64  # the coarse search selects one of so many places for the exact comparison


@dataclass(frozen=True)
class MetricLoad:
    """The load of the channels of one metric.

    Attributes:
        channels: numbers of the channels.
        read_bytes: bytes read per frame that shards divide: data of the places.
        projected_bytes: bytes read per frame that shards do not divide.
        mapped_bytes: size of the files of the map.
        has_lists: whether there are inverted lists.
    """

    channels: tuple[int, ...]
    read_bytes: int
    projected_bytes: int
    mapped_bytes: int
    has_lists: bool = False

    def is_sparse(self, shards: int) -> bool:
        """Whether the filter has beliefs of few places, in one of so many shards."""
        return self.has_lists and shards == 1


Service = Literal["router", "featurizer", "describer", "fuser", "channel"]


@dataclass(frozen=True)
class Process:
    """A process that runs on a host.

    Attributes:
        service: name of the service.
        frame_s: seconds of one core per frame.
        own_bytes: its own memory.
        mapped_bytes: memory of the map, which all processes of a host share.
        channels: channels that a channel worker serves.
        shard: number of the shard of each channel, from 0.
        shards: number of shards of each channel.
    """

    service: Service
    frame_s: float
    own_bytes: int = _PROCESS_BYTES
    mapped_bytes: int = 0
    channels: tuple[int, ...] = ()
    shard: int = 0
    shards: int = 1

    @property
    def memory_bytes(self) -> int:
        """Own memory and memory of the map."""
        return self.own_bytes + self.mapped_bytes


ROUTER = Process("router", _ROUTER_S)
"""The router, which each host has."""


def loads_of(manifest: Manifest, sizes: Mapping[str, int]) -> list[MetricLoad]:
    """Return the load of each metric of a map.

    Args:
        manifest: manifest of the map.
        sizes: size of each file of the map, bytes.

    Raises:
        MapError: a file of a metric has no size.
    """
    loads = []
    for number, metric in enumerate(manifest.metrics):
        files = [f"metrics/{number}/{name}.npy" for name in METRIC_FILES]
        if metric.coarse_unit is not None:
            files += [f"metrics/{number}/coarse/{name}.npy" for name in COARSE_FILES]
        looks = []
        if metric.looks:
            looks = [
                f"metrics/{number}/looks/{name}.npy" for name in look_files(metric.coarse_unit)
            ]
        lists = [f"metrics/{number}/coarse/lists/{name}.npy" for name in LIST_FILES]
        has_lists = any(file in sizes for file in lists)  # older maps are without
        for file in [*files, *looks, *(lists if has_lists else ())]:
            if file not in sizes:
                raise MapError(f"{file}: not in the manifest; {REBUILD}")
        own = {Path(file).stem: sizes[file] for file in files}
        of_looks = {Path(file).stem: sizes[file] for file in looks}
        read = own["places"] + of_looks.get("descriptors", 0)
        projected = own["projection"] if metric.learned else 0
        if metric.coarse_unit is not None:
            read = own["codes"] + of_looks.get("codes", 0) + read // _LOOKED_AT
            projected += own["axes"]
        channels = tuple(
            channel for channel, of in enumerate(manifest.channels) if of.metric == number
        )
        if channels:
            mapped = sum(sizes.get(file, 0) for file in files + looks + lists)
            loads.append(MetricLoad(channels, read, projected, mapped, has_lists))
    return loads


def services_of(manifest: Manifest) -> list[Process]:
    """Return the services that a run has once: featurizer and fuser."""
    kinds = kinds_of(manifest.features.kind)
    featurizer_s = sum(FEATURIZER_S.get(kind, _NETWORK_S) for kind in kinds)
    return [Process("featurizer", featurizer_s), Process("fuser", _FUSER_S)]


Group = list[MetricLoad]
"""Metrics whose channels are served by one worker."""


def groups_of(loads: Sequence[MetricLoad], places: int, count: int) -> list[Group]:
    """Partition metrics into so many groups: the costliest first, each to the cheapest group."""
    groups: list[Group] = [[] for _ in range(count)]
    for load in sorted(loads, key=lambda load: -_frame_s([load], places, 1)):
        min(groups, key=lambda group: _frame_s(group, places, 1)).append(load)
    return groups


def worker_of(group: Group, shards: int, places: int) -> Process:
    """Return the worker of the first of so many shards of a group; all shards cost the same."""
    channels = tuple(sorted(channel for load in group for channel in load.channels))
    full = sum(not load.is_sparse(shards) for load in group)  # channels share the beliefs
    beliefs = _BELIEFS_BYTES * full * places // shards
    return Process(
        "channel",
        _frame_s(group, places, shards),
        _PROCESS_BYTES + beliefs,
        sum(load.mapped_bytes for load in group) // shards,
        channels,
        shards=shards,
    )


def _frame_s(group: Group, places: int, shards: int) -> float:
    """Return the seconds per frame of a worker of one of so many shards."""
    alone = _READ_S * sum(load.projected_bytes for load in group)
    shared = sum(
        _SPARSE_S if load.is_sparse(shards) else _READ_S * load.read_bytes + _FILTER_S * places
        for load in group
    )
    return _WORKER_S + (_SHARD_S if shards > 1 else 0.0) + alone + shared / shards
