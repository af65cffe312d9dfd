"""Assigns the workers of a run to cores of hosts, by time and memory."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar


class Worker(Protocol):
    """A worker of one of several shards; all shards cost the same."""

    @property
    def frame_s(self) -> float:
        """Seconds of one core per frame."""

    @property
    def memory_bytes(self) -> int:
        """Memory that it needs on its host."""

    @property
    def shards(self) -> int:
        """Number of shards."""


AnyWorker = TypeVar("AnyWorker", bound=Worker)


@dataclass(frozen=True)
class Core:
    """A core without a worker.

    Attributes:
        busy_s: seconds per frame that the core spends on other processes.
        number: number of the core on its host.
        host: number of the host.
    """

    busy_s: float
    number: int
    host: int


@dataclass(frozen=True)
class Hosts:
    """Hosts without workers.

    Attributes:
        cores: cores of all hosts, the least busy first.
        held_bytes: memory of each host that other processes use.
    """

    cores: Sequence[Core]
    held_bytes: Sequence[int]


@dataclass(frozen=True)
class Limit:
    """The limits of seconds per frame for a core, and of memory for a host."""

    frame_s: float
    memory_bytes: float


@dataclass(frozen=True)
class Placement(Generic[AnyWorker]):
    """Workers, and the core of each.

    Attributes:
        workers: workers, each with its core.
        busiest_s: seconds per frame of the busiest core.
        most_bytes: memory of the host that needs most.
    """

    workers: Sequence[tuple[AnyWorker, Core]]
    busiest_s: float
    most_bytes: int

    def keeps_to(self, limit: Limit) -> bool:
        """Whether the placement is within both limits."""
        return self.busiest_s <= limit.frame_s and self.most_bytes <= limit.memory_bytes


def placements(
    groups: Sequence[AnyWorker], hosts: Hosts, limit: Limit
) -> list[Placement[AnyWorker]]:
    """Place all shards of each group by time, and also by memory if a host has too little.

    ``groups`` has one worker of each group. The first placement has the highest rate of all.
    """
    fastest = _by_time(groups, hosts)
    if fastest.most_bytes <= limit.memory_bytes:
        return [fastest]
    even = _by_memory(groups, hosts, limit, tight=False)
    if even.keeps_to(limit) or fastest.busiest_s > limit.frame_s:
        return [fastest, even]
    return [fastest, even, _by_memory(groups, hosts, limit, tight=True)]


def _by_time(groups: Sequence[AnyWorker], hosts: Hosts) -> Placement[AnyWorker]:
    """Assign the costliest worker to the least busy core, and so on.

    Equally busy cores take turns by host, so that memory is spread evenly.
    """
    costliest_first = sorted(groups, key=lambda worker: -worker.frame_s)
    workers = [worker for worker in costliest_first for _ in range(worker.shards)]
    return _placement(list(zip(workers, hosts.cores, strict=False)), hosts)


def _by_memory(
    groups: Sequence[AnyWorker], hosts: Hosts, limit: Limit, *, tight: bool
) -> Placement[AnyWorker]:
    """Assign the largest worker to a host where it fits, and so on.

    Of these hosts it is the one with the most free memory, or with the least if ``tight``. A worker
    that fits nowhere goes to the host with the most free memory.
    """
    cores: list[list[Core]] = [[] for _ in hosts.held_bytes]
    for core in hosts.cores:
        cores[core.host].append(core)
    left = [limit.memory_bytes - held for held in hosts.held_bytes]
    own: list[list[AnyWorker]] = [[] for _ in cores]
    free = [*reversed(range(len(cores)))]  # of equal hosts, prefer those without the services

    def fits(worker: AnyWorker, host: int) -> bool:
        used = len(own[host])
        return (
            used < len(cores[host])
            and worker.memory_bytes <= left[host]
            and cores[host][used].busy_s + worker.frame_s <= limit.frame_s
        )

    for worker in sorted(groups, key=lambda worker: -worker.memory_bytes):
        fitting = [host for host in free if fits(worker, host)]
        for _ in range(worker.shards):
            best = min if tight and fitting else max
            host = best(fitting or free, key=left.__getitem__)
            own[host].append(worker)
            left[host] -= worker.memory_bytes
            if len(own[host]) == len(cores[host]):
                free.remove(host)
            if host in fitting and not fits(worker, host):
                fitting.remove(host)
    pairs: list[tuple[AnyWorker, Core]] = []
    for workers, own_cores in zip(own, cores, strict=True):
        costliest_first = sorted(workers, key=lambda worker: -worker.frame_s)
        pairs += zip(costliest_first, own_cores, strict=False)
    return _placement(pairs, hosts)


def _placement(pairs: Sequence[tuple[AnyWorker, Core]], hosts: Hosts) -> Placement[AnyWorker]:
    needed = list(hosts.held_bytes)
    busiest_s = hosts.cores[-1].busy_s
    for worker, core in pairs:
        needed[core.host] += worker.memory_bytes
        busy_s = core.busy_s + worker.frame_s
        if busy_s > busiest_s:
            busiest_s = busy_s
    return Placement(pairs, busiest_s, max(needed))
