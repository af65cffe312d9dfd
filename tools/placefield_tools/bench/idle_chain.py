"""The chain that does no work: the same processes and messages, with nothing in between.

What it takes from a frame to its match is what the bus and the wake-ups of Python take, which no
matcher, however fast, gets below. ``python -m placefield_tools.bench.idle_chain SHAPE --endpoint
ENDPOINT`` starts a host like ``placefield up``.
"""

import argparse
import dataclasses
import json
import sys
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys, Part
from placefield.bus.message import Message
from placefield.bus.messages import MatchMessage
from placefield.bus.session import Bus
from placefield.config import BusConfig, Config
from placefield.maps.digest import NO_DIGEST
from placefield_services.forkserver import Program
from placefield_services.host import run_host
from placefield_services.process import ServiceProcess, stop_event

_SELF = (sys.executable, "-m", __spec__.name)


@dataclass(frozen=True)
class Shape:
    """What the chain is to look like.

    Attributes:
        workers: the channels of each channel worker.
        feature: size of the featurizer's messages, bytes.
        candidates: of the workers'.
    """

    workers: tuple[tuple[int, ...], ...]
    feature: int
    candidates: int

    @property
    def channels(self) -> int:
        """How many channels the workers have together."""
        return sum(map(len, self.workers))

    def command(self) -> list[str]:
        """Return the command line of the host, which takes ``--endpoint``."""
        return [*_SELF, json.dumps(dataclasses.asdict(self))]

    @classmethod
    def read(cls, text: str) -> "Shape":
        """Read the shape back from a command line."""
        values = json.loads(text)
        workers = tuple(tuple(channels) for channels in values.pop("workers"))
        return cls(workers, **values)


class _Filler(Message):
    """A payload that nobody reads."""

    data: bytes

    @classmethod
    def of(cls, size: int) -> "_Filler":
        return cls(data=bytes(size))

    def encode(self) -> bytes:
        return self.data


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the host, or, with ``--role``, one of its services."""
    parser = argparse.ArgumentParser()
    parser.add_argument("shape", type=Shape.read)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--role", choices=["featurizer", "channel", "fuser"])
    parser.add_argument("--worker", type=int, default=0)
    given = parser.parse_args(arguments)
    config, stop = Config(bus=BusConfig(endpoint=given.endpoint)), stop_event()
    if given.role is None:
        _run_host(given.shape, config, stop)
        return
    with open_bus(config.bus, stop) as bus:
        if given.role == "featurizer":
            _featurizer(given.shape, bus, stop)
        elif given.role == "channel":
            _channels(given.shape, given.shape.workers[given.worker], bus, stop)
        else:
            _fuser(given.shape, bus, stop)


def _run_host(shape: Shape, config: Config, stop: threading.Event) -> None:
    own = [*shape.command(), "--endpoint", config.bus.endpoint, "--role"]
    commands = {"featurizer": [*own, "featurizer"], "fuser": [*own, "fuser"]}
    for worker in range(len(shape.workers)):
        commands[f"channel worker {worker}"] = [*own, "channel", "--worker", str(worker)]
    program = Program(_run_service, preload=[run_host.__module__])
    run_host(program, commands, shape.channels, config, stop, lambda: print("ready", flush=True))


def _run_service(command: Sequence[str]) -> None:
    main(command[len(_SELF) :])


def _featurizer(shape: Shape, bus: Bus, stop: threading.Event) -> None:
    publisher, feature = bus.publisher(_KEYS.feature), _Filler.of(shape.feature)

    def handle(received: Received) -> None:
        publisher.put(received.header, None if received.header.end else feature)

    process = ServiceProcess("featurizer", bus, [_KEYS.run])
    _serve(process, bus, [_KEYS.frame], handle, [process.identity], stop)


def _channels(shape: Shape, channels: tuple[int, ...], bus: Bus, stop: threading.Event) -> None:
    process = ServiceProcess("channel", bus, [_KEYS.run])
    publisher = bus.publisher(_KEYS.candidates(process.identity))
    candidates = _Filler.of(shape.candidates)

    def handle(received: Received) -> None:
        publisher.put(received.header, None if received.header.end else candidates)

    identities = [Part(channel).identity(process.identity) for channel in channels]
    _serve(process, bus, [_KEYS.feature], handle, identities, stop)


def _fuser(shape: Shape, bus: Bus, stop: threading.Event) -> None:
    matches, acks = bus.publisher(_KEYS.match), bus.publisher(_KEYS.ack)
    match = MatchMessage(map=NO_DIGEST, place=0, score=0.0, probability=1.0, known=True)
    come: Counter[tuple[str, int]] = Counter()

    def handle(received: Received) -> None:
        header = received.header
        frame = header.stream, header.sequence
        come[frame] += 1
        if come[frame] <= len(shape.workers):  # the feature comes besides
            return
        del come[frame]
        matches.put(header, None if header.end else match)
        acks.put(header)

    process = ServiceProcess("fuser", bus, [_KEYS.run])
    subscribed = [_KEYS.feature, _KEYS.all_candidates]
    _serve(process, bus, subscribed, handle, [process.identity], stop)


_KEYS = Keys(Config().run)


def _serve(
    process: ServiceProcess,
    bus: Bus,
    subscribed: list[str],
    handle: Callable[[Received], None],
    identities: list[str],
    stop: threading.Event,
) -> None:
    inbox = Inbox(process.counts)
    for key in subscribed:
        bus.subscribe(key, inbox.offer, process.counts[_KEYS.run])
    for identity in identities:
        process.declare_ready(identity)
    process.serve(inbox, handle, stop)


if __name__ == "__main__":
    main()
