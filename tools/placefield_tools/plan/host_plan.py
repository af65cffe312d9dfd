"""Which process of a run goes to which host, by an estimate of what each costs.

A frame costs a channel worker what it reads: the codes of all places under each metric, or a few
bytes of each where the map is built for a coarse look, and the beliefs of each channel. Shards cut
that into parts. Channels of one metric stay together, for frames are compared once for all of them.

The constants are of the machine of docs/performance.md; rule ``filter``.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, get_args

from placefield.errors import MapError
from placefield.maps.array_layout import COARSE_FILES, METRIC_FILES
from placefield.maps.manifest import REBUILD, Manifest
from placefield_tools.plan.placement import Core, Hosts, Limit, Placement, placements

ROOM = 0.7
"""Share of a core that is given away: the estimate is rough, and other work goes on."""

LEAST_SHARD = 10_000
"""Places: with fewer a shard spends more on telling the others than it saves."""

# Seconds of a core for a frame.
_FEATURIZER_S = {"gist": 5.3e-3, "grayscale": 3.5e-3}
_NETWORK_S = 30e-3  # a small one
_FUSER_S = 2.1e-3
_ROUTER_S = 1.3e-3
_WORKER_S = 1.2e-3  # to wake up, and to answer
_SHARD_S = 1.0e-3  # more, to hear of the other shards and be heard
_READ_S = 1 / 15e9  # for a byte of places or of a projection
_FILTER_S = 25e-9  # for a place of a channel: move its beliefs, weigh them

_PROCESS_BYTES = 120_000_000  # Python and its libraries
_BELIEFS_BYTES = 2 * 7 * 4 + 24  # of a place of a channel; the second, what it is weighed by
_LOOKED_AT = 64  # of so many places one is near enough at the coarse look for an exact one


@dataclass(frozen=True)
class MetricLoad:
    """What the channels of one metric take.

    Attributes:
        channels: their numbers.
        read_bytes: for a frame, of what is of places.
        projected_bytes: for a frame, of what is not.
        mapped_bytes: of the files of the map.
    """

    channels: tuple[int, ...]
    read_bytes: int
    projected_bytes: int
    mapped_bytes: int


Service = Literal["router", "featurizer", "fuser", "channel"]


@dataclass(frozen=True)
class Process:
    """A process that runs on a host.

    Attributes:
        service: which.
        frame_s: seconds of a core that it takes for a frame.
        own_bytes: of memory that is its alone.
        mapped_bytes: of the map, which all processes of a host share.
        channels: that it serves, if it is a channel worker.
        shard: which one of each, from 0.
        shards: into how many they are cut.
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
        """Of its own and of the map."""
        return self.own_bytes + self.mapped_bytes


_ROUTER = Process("router", _ROUTER_S)


@dataclass(frozen=True)
class Plan:
    """A placement.

    Attributes:
        hosts: their processes, each in the order in which to start them.
        busiest_s: seconds for a frame of the core that has most to do.
    """

    hosts: tuple[tuple[Process, ...], ...]
    busiest_s: float

    @property
    def highest_rate(self) -> float:
        """Frames per second that all cores can do."""
        return 1 / self.busiest_s

    @property
    def memory_bytes(self) -> list[int]:
        """Of each host; no two of its workers have the same part of the map."""
        return [sum(each.memory_bytes for each in host) for host in self.hosts]

    def has_time(self, rate: float) -> bool:
        """Whether so many frames per second leave room on every core."""
        return self.busiest_s <= ROOM / rate

    def suffices(self, rate: float, memory_bytes: float = math.inf) -> bool:
        """Whether it has time, and no host needs more memory than this."""
        return self.has_time(rate) and max(self.memory_bytes) <= memory_bytes


def loads_of(manifest: Manifest, sizes: Mapping[str, int]) -> list[MetricLoad]:
    """Return what each metric of a map takes, given the bytes of its files.

    Raises:
        MapError: one of its files is not among them.
    """
    loads = []
    for number, metric in enumerate(manifest.metrics):
        files = [f"metrics/{number}/{name}.npy" for name in METRIC_FILES]
        if metric.coarse_unit is not None:
            files += [f"metrics/{number}/coarse/{name}.npy" for name in COARSE_FILES]
        for file in files:
            if file not in sizes:
                raise MapError(f"{file}: not in the manifest; {REBUILD}")
        own = {Path(file).stem: sizes[file] for file in files}
        read, projected = own["places"], own["projection"] if metric.learned else 0
        if metric.coarse_unit is not None:
            read = own["codes"] + own["places"] // _LOOKED_AT
            projected += own["axes"]
        channels = tuple(
            channel for channel, of in enumerate(manifest.channels) if of.metric == number
        )
        if channels:
            loads.append(MetricLoad(channels, read, projected, sum(own.values())))
    return loads


def services_of(manifest: Manifest) -> list[Process]:
    """Return the services besides channel workers that a run has one of."""
    featurizer_s = _FEATURIZER_S.get(manifest.features.kind, _NETWORK_S)
    return [Process("featurizer", featurizer_s), Process("fuser", _FUSER_S)]


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
    """Place the channels of a map, with no more than one worker on a core.

    Of all ways that are tried and suffice it is the one with the fewest shards of a channel, and of
    those the one with the fewest workers: if one shard fails, the channel has no answer. If none
    suffices, it is the one that needs the least memory beyond what there is, and of those the one
    that can do the highest rate.

    Args:
        loads: of all metrics.
        services: that go to the first host.
        places: of the map.
        hosts: how many.
        cores: of each host.
        rate: frames per second that are wanted.
        memory_bytes: of each host.
    """
    beside = [[*(services if host == 0 else ()), _ROUTER] for host in range(hosts)]
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
    """Give each process to the core of its host that has least to do."""
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
    """Yield placements of uncut lots, and of those with a shard more of the largest, and so on.

    The largest is that which takes most of what is short, time or memory. It ends where one
    suffices, where there are no more cores, or where that lot cannot be cut further.
    """
    for count in range(1, min(len(loads), len(hosts.cores)) + 1):
        lots = _lots(loads, places, count)
        workers = [_worker(lot, 1, places) for lot in lots]
        while True:
            ways = placements(workers, hosts, limit)
            yield from ways
            enough = any(way.keeps_to(limit) for way in ways)
            if enough or sum(worker.shards for worker in workers) == len(hosts.cores):
                break
            if ways[0].busiest_s > limit.frame_s:
                takes = [worker.frame_s for worker in workers]
            else:
                takes = [float(worker.memory_bytes) for worker in workers]
            largest = takes.index(max(takes))
            shards = workers[largest].shards + 1
            if places // shards < LEAST_SHARD:
                break
            workers[largest] = _worker(lots[largest], shards, places)


Lot = list[MetricLoad]


def _lots(loads: Sequence[MetricLoad], places: int, count: int) -> list[Lot]:
    """Deal metrics to so many lots, the costliest first, each to the lot that costs least."""
    lots: list[Lot] = [[] for _ in range(count)]
    for load in sorted(loads, key=lambda load: -_frame_s([load], places, 1)):
        min(lots, key=lambda lot: _frame_s(lot, places, 1)).append(load)
    return lots


def _worker(lot: Lot, shards: int, places: int) -> Process:
    """Return the first of the workers of a lot, which take the same."""
    channels = tuple(sorted(channel for load in lot for channel in load.channels))
    beliefs = _BELIEFS_BYTES * len(channels) * places // shards
    return Process(
        "channel",
        _frame_s(lot, places, shards),
        _PROCESS_BYTES + beliefs,
        sum(load.mapped_bytes for load in lot) // shards,
        channels,
        shards=shards,
    )


def _frame_s(lot: Lot, places: int, shards: int) -> float:
    """Return the seconds for a frame of a worker of one of so many shards."""
    alone = _READ_S * sum(load.projected_bytes for load in lot)
    shared = sum(
        _READ_S * load.read_bytes + _FILTER_S * places * len(load.channels) for load in lot
    )
    return _WORKER_S + (_SHARD_S if shards > 1 else 0.0) + alone + shared / shards


def _processes(
    beside: Sequence[Sequence[Process]], placement: Placement[Process]
) -> tuple[tuple[Process, ...], ...]:
    """Return the processes of each host in order, the shards of each lot numbered."""
    on = [list(processes) for processes in beside]
    shards: Counter[tuple[int, ...]] = Counter()
    for worker, core in placement.workers:
        on[core.host].append(replace(worker, shard=shards[worker.channels]))
        shards[worker.channels] += 1
    return tuple(tuple(sorted(processes, key=_turn)) for processes in on)


def _turn(process: Process) -> tuple[int, int, tuple[int, ...]]:
    return get_args(Service).index(process.service), process.shard, process.channels
