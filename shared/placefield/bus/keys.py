"""The keys of a run on the bus, all spelled here."""

import re
from dataclasses import dataclass

ROOT = "placefield"

EVERY_TOKEN = f"{ROOT}/*/alive/*/*"
"""Liveliness tokens of all runs."""

_PART = re.compile(r"([0-9]{1,5})(?:\.([0-9]{1,5})of([0-9]{1,5}))?-[0-9A-Za-z_]+")


@dataclass(frozen=True)
class Keys:
    """The keys of the run of this name."""

    run: str

    @property
    def frame(self) -> str:
        """Frames, from a source to the featurizer."""
        return f"{ROOT}/{self.run}/frame"

    def raw(self, worker: str) -> str:
        """Raw features of one describer, to the featurizer."""
        return f"{ROOT}/{self.run}/raw/{worker}"

    @property
    def all_raws(self) -> str:
        """Raw features of all describers."""
        return f"{ROOT}/{self.run}/raw/*"

    @property
    def feature(self) -> str:
        """Descriptors, from the featurizer to the channels."""
        return f"{ROOT}/{self.run}/feature"

    @property
    def unobserved(self) -> str:
        """Frames that are missing observations, from the featurizer to their source."""
        return f"{ROOT}/{self.run}/unobserved"

    def candidates(self, worker: str) -> str:
        """Candidates of all channels of one worker, to the fuser."""
        return f"{ROOT}/{self.run}/candidate/{worker}"

    @property
    def all_candidates(self) -> str:
        """Candidates of all workers."""
        return f"{ROOT}/{self.run}/candidate/*"

    @property
    def match(self) -> str:
        """Matches, from the fuser to the source and any reader."""
        return f"{ROOT}/{self.run}/match"

    @property
    def smoothed(self) -> str:
        """Smoothed matches, from the fuser to any reader."""
        return f"{ROOT}/{self.run}/smoothed"

    @property
    def verified(self) -> str:
        """Smoothed matches after their verification, from the verifiers to any reader."""
        return f"{ROOT}/{self.run}/verified"

    @property
    def odometry(self) -> str:
        """Metres travelled, from the vehicle to the source of its camera's frames."""
        return f"{ROOT}/{self.run}/odometry"

    @property
    def ack(self) -> str:
        """Credits: frames that have been answered, from the fuser to the source."""
        return f"{ROOT}/{self.run}/ack"

    @property
    def moments(self) -> str:
        """Moments of the frames so far, from the featurizer to the replay caches of services."""
        return f"{ROOT}/{self.run}/moments"

    def halo(self, worker: str) -> str:
        """Partial results of a worker's shards, to the workers of the other shards."""
        return f"{ROOT}/{self.run}/halo/{worker}"

    @property
    def all_halos(self) -> str:
        """Partial results of all shards."""
        return f"{ROOT}/{self.run}/halo/*"

    def cache(self, key: str) -> str:
        """Key to query the replay caches of a key of this run."""
        return f"{ROOT}/{self.run}/cache/{key.split('/')[2]}"

    @property
    def all_caches(self) -> str:
        """Keys of all replay caches."""
        return f"{ROOT}/{self.run}/cache/*"

    def alive(self, service: str, identity: str) -> str:
        """Liveliness token of one process of a service; it exists while the process is ready."""
        return f"{ROOT}/{self.run}/alive/{service}/{identity}"

    def all_alive(self, service: str = "*") -> str:
        """Liveliness tokens of all processes of a service, or of all services."""
        return f"{ROOT}/{self.run}/alive/{service}/*"

    def stats(self, service: str, identity: str) -> str:
        """Counts of one process, once a second."""
        return f"{ROOT}/{self.run}/stats/{service}/{identity}"

    @property
    def all_stats(self) -> str:
        """Counts of all processes."""
        return f"{ROOT}/{self.run}/stats/*/*"


def run_of(key: str) -> str:
    """Return the name of a key's run."""
    return key.split("/", 2)[1]


def service_and_identity(key: str) -> tuple[str, str]:
    """Return the last two parts of an ``alive`` or ``stats`` key."""
    _, service, identity = key.rsplit("/", 2)
    return service, identity


@dataclass(frozen=True)
class Part:
    """A part of the map that a channel worker serves: a channel, or one shard of it."""

    channel: int
    shard: int = 0
    shards: int = 1

    def identity(self, worker: str) -> str:
        """Return the name of this part's token at a worker, as ``2-ab12`` or ``2.0of4-ab12``."""
        shard = f".{self.shard}of{self.shards}" if self.shards > 1 else ""
        return f"{self.channel}{shard}-{worker}"


def part_of(identity: str) -> Part | None:
    """Read the part from the name of its token; None if the name is malformed."""
    found = _PART.fullmatch(identity)
    if found is None:
        return None
    channel, shard, shards = (
        int(number or default) for number, default in zip(found.groups(), (0, 0, 1), strict=True)
    )
    return Part(channel, shard, shards) if shard < shards else None
