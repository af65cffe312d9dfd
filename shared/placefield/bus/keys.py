"""The keys of a run: one place that spells them."""

from dataclasses import dataclass

ROOT = "placefield"


@dataclass(frozen=True)
class Keys:
    """The keys of the run of this name."""

    run: str

    @property
    def frame(self) -> str:
        """Frames, from a source to the featurizer."""
        return f"{ROOT}/{self.run}/frame"

    @property
    def feature(self) -> str:
        """Descriptors, from the featurizer to the channels."""
        return f"{ROOT}/{self.run}/feature"

    def candidate(self, channel: int, shard: int = 0) -> str:
        """Candidates of one channel, to the fuser."""
        return f"{ROOT}/{self.run}/candidate/{channel}/{shard}"

    @property
    def all_candidates(self) -> str:
        """Candidates of all channels."""
        return f"{ROOT}/{self.run}/candidate/*/*"

    @property
    def match(self) -> str:
        """Matches, from the fuser to whoever wants them."""
        return f"{ROOT}/{self.run}/match"

    @property
    def odometry(self) -> str:
        """Metres travelled, from the vehicle to whoever takes its camera's frames by distance."""
        return f"{ROOT}/{self.run}/odometry"

    @property
    def ack(self) -> str:
        """Credits: frames that have been answered, from the fuser to the source."""
        return f"{ROOT}/{self.run}/ack"

    def alive(self, service: str, identity: str) -> str:
        """Liveliness token of one process of a service: present means ready."""
        return f"{ROOT}/{self.run}/alive/{service}/{identity}"

    def all_alive(self, service: str = "*") -> str:
        """Liveliness tokens of a service, or of all."""
        return f"{ROOT}/{self.run}/alive/{service}/*"

    def stats(self, service: str, identity: str) -> str:
        """Counts of one process, once a second."""
        return f"{ROOT}/{self.run}/stats/{service}/{identity}"

    @property
    def all_stats(self) -> str:
        """Counts of all processes."""
        return f"{ROOT}/{self.run}/stats/*/*"


def run_of(key: str) -> str:
    """Return the run that a key is of."""
    return key.split("/", 2)[1]


def service_and_identity(key: str) -> tuple[str, str]:
    """Return the last two parts of an ``alive`` or ``stats`` key."""
    _, service, identity = key.rsplit("/", 2)
    return service, identity


def channel_identity(channel: int, identity: str) -> str:
    """Name the token of one channel of a worker."""
    return f"{channel}-{identity}"


def channel_of(identity: str) -> int | None:
    """Read the channel from such a name; None if it is no such name."""
    channel = identity.partition("-")[0]
    return int(channel) if channel.isdecimal() else None
