"""Which core of which host gets which worker of a run, by the time and the memory that it takes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar


class Worker(Protocol):
    """One of so many shards, which all take the same."""

    @property
    def frame_s(self) -> float:
        """Seconds of a core for a frame."""

    @property
    def memory_bytes(self) -> int:
        """Of its host."""

    @property
    def shards(self) -> int:
        """How many there are."""


AnyWorker = TypeVar("AnyWorker", bound=Worker)


@dataclass(frozen=True)
class Core:
    """A core without a worker.

    Attributes:
        busy_s: seconds for a frame that it has to do for other processes.
        number: which of its host.
        host: which.
    """

    busy_s: float
    number: int
    host: int


@dataclass(frozen=True)
class Hosts:
    """Hosts without workers.

    Attributes:
        cores: of all, that with least to do first.
        held_bytes: of memory of each host, by other processes.
    """

    cores: Sequence[Core]
    held_bytes: Sequence[int]


@dataclass(frozen=True)
class Limit:
    """What no core and no host may go beyond, for a frame and in memory."""

    frame_s: float
    memory_bytes: float


@dataclass(frozen=True)
class Placement(Generic[AnyWorker]):
    """Workers, and the core of each.

    Attributes:
        workers: each with its core.
        busiest_s: seconds for a frame of the core that has most to do.
        most_bytes: of the host that needs most memory.
    """

    workers: Sequence[tuple[AnyWorker, Core]]
    busiest_s: float
    most_bytes: int

    def keeps_to(self, limit: Limit) -> bool:
        """Whether it goes beyond neither."""
        return self.busiest_s <= limit.frame_s and self.most_bytes <= limit.memory_bytes


def placements(lots: Sequence[AnyWorker], hosts: Hosts, limit: Limit) -> list[Placement[AnyWorker]]:
    """Place all shards of each lot by time, and by memory too where a host has not enough of it.

    The lots are given by a worker of each. The first placement does the most frames that any can.
    """
    fastest = _by_time(lots, hosts)
    if fastest.most_bytes <= limit.memory_bytes:
        return [fastest]
    even = _by_memory(lots, hosts, limit, tight=False)
    if even.keeps_to(limit) or fastest.busiest_s > limit.frame_s:
        return [fastest, even]
    return [fastest, even, _by_memory(lots, hosts, limit, tight=True)]


def _by_time(lots: Sequence[AnyWorker], hosts: Hosts) -> Placement[AnyWorker]:
    """Give the costliest worker to the core that has least to do, and so on.

    Cores that have as much to do take turns by host, and so memory is as even as can be.
    """
    costliest_first = sorted(lots, key=lambda worker: -worker.frame_s)
    workers = [worker for worker in costliest_first for _ in range(worker.shards)]
    return _placement(list(zip(workers, hosts.cores, strict=False)), hosts)


def _by_memory(
    lots: Sequence[AnyWorker], hosts: Hosts, limit: Limit, *, tight: bool
) -> Placement[AnyWorker]:
    """Give the largest worker to a host where it fits, and so on.

    That is the host with the most memory left, or, where it is to be tight, the one with the least.
    A worker that fits nowhere goes where most memory is left.
    """
    cores: list[list[Core]] = [[] for _ in hosts.held_bytes]
    for core in hosts.cores:
        cores[core.host].append(core)
    left = [limit.memory_bytes - held for held in hosts.held_bytes]
    own: list[list[AnyWorker]] = [[] for _ in cores]
    free = [*reversed(range(len(cores)))]  # of hosts that are alike not the one with the services

    def fits(worker: AnyWorker, host: int) -> bool:
        used = len(own[host])
        return (
            used < len(cores[host])
            and worker.memory_bytes <= left[host]
            and cores[host][used].busy_s + worker.frame_s <= limit.frame_s
        )

    for worker in sorted(lots, key=lambda worker: -worker.memory_bytes):
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
