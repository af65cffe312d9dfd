"""Assigns the processes of a run to hosts, by an estimate of their cost.

The cost of a frame for a channel worker is what it reads: the places under each metric, or a few
bytes of each place if the map has a coarse search, and the beliefs of each channel. Shards divide
this cost. With inverted lists, a whole channel costs the same on a map of any size, and a shard as
without them. Channels of one metric stay together, because a frame is compared once for all.

The constants were measured on the machine of docs/performance.md, for the rule ``filter``.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from placefield.errors import MapError
from placefield.features.kinds import DESCRIPTOR, kinds_of
from placefield.maps.array_layout import COARSE_FILES, LIST_FILES, METRIC_FILES, look_files
from placefield.maps.manifest import REBUILD, Manifest
from placefield_tools.plan.placement import Core, Hosts, Limit, Placement, placements

ROOM = 0.7
"""Share of a core to use: the estimate is rough, and the machine has other work."""

LEAST_SHARD = 10_000
"""Minimum number of places: a smaller shard spends more on its messages than it saves."""

# Seconds of one core per frame.
_FEATURIZER_S = {"gist": 5.3e-3, "grayscale": 3.5e-3, DESCRIPTOR: 1.0e-3}
_NETWORK_S = 30e-3  # a small one
_FUSER_S = 2.1e-3
_ROUTER_S = 1.3e-3
_WORKER_S = 1.2e-3  # to wake up, and to answer
_SHARD_S = 1.0e-3  # additional, to exchange partial results with the other shards
_READ_S = 1 / 15e9  # per byte of places or of a projection
_FILTER_S = 25e-9  # per place of a channel: predict and update its beliefs
_SPARSE_S = 4e-3  # per metric with inverted lists: what the lists propose, and its beliefs

_PROCESS_BYTES = 120_000_000  # Python and its libraries
_BELIEFS_BYTES = 2 * 7 * 4 + 24  # per place of a channel: beliefs, and likelihoods
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


_ROUTER = Process("router", _ROUTER_S)


@dataclass(frozen=True)
class Plan:
    """A proposed placement.

    Attributes:
        hosts: processes of each host, in the order in which to start them.
        busiest_s: seconds per frame of the busiest core.
    """

    hosts: tuple[tuple[Process, ...], ...]
    busiest_s: float

    @property
    def highest_rate(self) -> float:
        """Frames per second that the busiest core can process."""
        return 1 / self.busiest_s

    @property
    def memory_bytes(self) -> list[int]:
        """Memory of each host; no two workers of a host share a part of the map."""
        return [sum(each.memory_bytes for each in host) for host in self.hosts]

    def has_time(self, rate: float) -> bool:
        """Whether every core has time for so many frames per second."""
        return self.busiest_s <= ROOM / rate

    def suffices(self, rate: float, memory_bytes: float = math.inf) -> bool:
        """Whether every core has time, and no host needs more memory than this."""
        return self.has_time(rate) and max(self.memory_bytes) <= memory_bytes


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
    featurizer_s = sum(_FEATURIZER_S.get(kind, _NETWORK_S) for kind in kinds)
    return [Process("featurizer", featurizer_s), Process("fuser", _FUSER_S)]


def with_describers(services: Sequence[Process], rate: float, most: int) -> list[Process]:
    """Add the describers without which the featurizer has no time for ``rate``, ``most`` at most.

    Featurizer and describers describe equal shares of the frames.
    """
    (featurizer,) = (each for each in services if each.service == "featurizer")
    others = [each for each in services if each is not featurizer]
    own_s = _FEATURIZER_S[DESCRIPTOR]
    describing_s = max(featurizer.frame_s - own_s, 0.0)
    shares = (describing_s / (count + 1) for count in range(most + 1))
    fitting = (n for n, share_s in enumerate(shares) if own_s + share_s <= ROOM / rate)
    count = next(fitting, most) if describing_s else 0
    share_s = describing_s / (count + 1)
    described = replace(featurizer, frame_s=featurizer.frame_s - describing_s + share_s)
    return [described, *[Process("describer", share_s)] * count, *others]


def plan(
    loads: Sequence[MetricLoad],
    services: Sequence[Process],
    places: int,
    *,
    hosts: int,
    cores: int,
    rate: float,
    memory_bytes: float = math.inf,
) -> Plan:
    """Place the channels of a map, with at most one worker per core.

    Among the placements that suffice, the plan has the fewest shards per channel, then the fewest
    workers: if one shard fails, its channel has no answer. If no placement suffices, the plan
    exceeds the memory by the least, then has the highest rate.

    Args:
        loads: load of each metric.
        services: services of the first host; describers are placed on all hosts, the last first.
        places: number of places of the map.
        hosts: number of hosts.
        cores: number of cores of each host.
        rate: frames per second wanted.
        memory_bytes: memory of each host.
    """
    describers = [each for each in services if each.service == "describer"]
    others = [each for each in services if each.service != "describer"]
    beside = [
        [*(others if host == 0 else ()), _ROUTER, *describers[hosts - 1 - host :: hosts]]
        for host in range(hosts)
    ]
    limit = Limit(ROOM / rate, memory_bytes)

    def preference(way: Placement[Process]) -> tuple[bool, float, float, int, int, float]:
        suffices = way.keeps_to(limit)
        beyond = max(0.0, way.most_bytes - memory_bytes)
        shards = max(worker.shards for worker, _ in way.workers)
        to_do = 0.0 if suffices else way.busiest_s
        return not suffices, beyond, to_do, shards, len(way.workers), way.busiest_s

    best = min(_tried(loads, places, _without_workers(beside, cores), limit), key=preference)
    return Plan(_processes(beside, best), best.busiest_s)


def _without_workers(beside: Sequence[Sequence[Process]], cores: int) -> Hosts:
    """Assign each process to the least busy core of its host."""
    free = []
    for host, processes in enumerate(beside):
        busy_s = [0.0] * cores
        for process in processes:
            busy_s[busy_s.index(min(busy_s))] += process.frame_s
        free += [Core(busy, number, host) for number, busy in enumerate(busy_s)]
    held = [sum(process.memory_bytes for process in processes) for processes in beside]
    return Hosts(sorted(free, key=lambda core: (core.busy_s, core.number, core.host)), held)


def _tried(
    loads: Sequence[MetricLoad], places: int, hosts: Hosts, limit: Limit
) -> Iterator[Placement[Process]]:
    """Yield placements of whole groups, then with one more shard of the largest group, and so on.

    The largest group needs most of the scarce resource, time or memory. The search ends when a
    placement suffices, when all cores are used, or when the group cannot be cut further.
    """
    for count in range(1, min(len(loads), len(hosts.cores)) + 1):
        groups = _groups(loads, places, count)
        workers = [_worker(group, 1, places) for group in groups]
        while True:
            ways = placements(workers, hosts, limit)
            yield from ways
            enough = any(way.keeps_to(limit) for way in ways)
            if enough or sum(worker.shards for worker in workers) == len(hosts.cores):
                break
            if ways[0].busiest_s > limit.frame_s:
                needs = [worker.frame_s for worker in workers]
            else:
                needs = [float(worker.memory_bytes) for worker in workers]
            largest = needs.index(max(needs))
            shards = workers[largest].shards + 1
            if places // shards < LEAST_SHARD:
                break
            workers[largest] = _worker(groups[largest], shards, places)


Group = list[MetricLoad]


def _groups(loads: Sequence[MetricLoad], places: int, count: int) -> list[Group]:
    """Partition metrics into so many groups: the costliest first, each to the cheapest group."""
    groups: list[Group] = [[] for _ in range(count)]
    for load in sorted(loads, key=lambda load: -_frame_s([load], places, 1)):
        min(groups, key=lambda group: _frame_s(group, places, 1)).append(load)
    return groups


def _worker(group: Group, shards: int, places: int) -> Process:
    """Return the worker of the first shard of a group; all shards cost the same."""
    channels = tuple(sorted(channel for load in group for channel in load.channels))
    every = sum(len(load.channels) for load in group if not load.is_sparse(shards))
    beliefs = _BELIEFS_BYTES * every * places // shards
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
        _SPARSE_S
        if load.is_sparse(shards)
        else _READ_S * load.read_bytes + _FILTER_S * places * len(load.channels)
        for load in group
    )
    return _WORKER_S + (_SHARD_S if shards > 1 else 0.0) + alone + shared / shards


def _processes(
    beside: Sequence[Sequence[Process]], placement: Placement[Process]
) -> tuple[tuple[Process, ...], ...]:
    """Return the processes of each host in order, with their shards numbered."""
    on = [list(processes) for processes in beside]
    shards: Counter[tuple[int, ...]] = Counter()
    for worker, core in placement.workers:
        on[core.host].append(replace(worker, shard=shards[worker.channels]))
        shards[worker.channels] += 1
    return tuple(tuple(sorted(processes, key=_turn)) for processes in on)


def _turn(process: Process) -> tuple[int, int, tuple[int, ...]]:
    return get_args(Service).index(process.service), process.shard, process.channels
