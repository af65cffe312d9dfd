"""Assigns the processes of a run to hosts, by an estimate of their cost.

Channels of one metric stay together, because a frame is compared once for all.
"""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import get_args

from placefield.features.kinds import DESCRIPTOR
from placefield_tools.plan.placement import Core, Hosts, Limit, Placement, placements
from placefield_tools.plan.process_cost import (
    FEATURIZER_S,
    ROUTER,
    MetricLoad,
    Process,
    Service,
    groups_of,
    worker_of,
)

ROOM = 0.7
"""Share of a core to use: the estimate is rough, and the machine has other work."""

LEAST_SHARD = 10_000
"""Minimum number of places: a smaller shard spends more on its messages than it saves."""


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


def with_describers(services: Sequence[Process], rate: float, most: int) -> list[Process]:
    """Add the describers without which the featurizer has no time for ``rate``, ``most`` at most.

    Featurizer and describers describe equal shares of the frames.
    """
    (featurizer,) = (each for each in services if each.service == "featurizer")
    others = [each for each in services if each is not featurizer]
    own_s = FEATURIZER_S[DESCRIPTOR]
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
        [*(others if host == 0 else ()), ROUTER, *describers[hosts - 1 - host :: hosts]]
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
        groups = groups_of(loads, places, count)
        workers = [worker_of(group, 1, places) for group in groups]
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
            workers[largest] = worker_of(groups[largest], shards, places)


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
