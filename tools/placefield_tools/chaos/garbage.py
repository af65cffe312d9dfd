"""Bad messages that an untrusted client or a defect may publish: of every sort, on every topic.

They are made from messages received on the bus, so that every topic and field is covered.
"""

import random
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import msgpack

from placefield.bus.inbox import Received
from placefield.bus.keys import ROOT, Keys
from placefield.bus.message import Header, Message
from placefield.bus.messages import OdometryMessage
from placefield.bus.session import Bus

_KEPT = 64  # received messages of a topic
_LARGE = 2**16  # bytes
_VERSION: int = Message.model_fields["version"].default
_ODD_NAMES = ("-1-x", "7-x", "٣-x", "%s", "a b", "0", "-", "9" * 5000 + "-x", "new\nline-x")


class ReceivedTraffic:
    """Keeps the first messages of every topic of a run, also those without a header."""

    def __init__(self, bus: Bus, keys: Keys) -> None:
        self.topics: dict[str, list[Received]] = {}
        bus.subscribe(f"{ROOT}/{keys.run}/**", self._keep, Counter(), ends_empty=False)
        bus.subscribe_raw(keys.all_stats, self._keep_bare)
        self._keep_bare(keys.odometry, OdometryMessage(metres=1.0).encode())
        self._keep_bare(f"{ROOT}/{keys.run}/unused", b"unused")

    def _keep(self, received: Received) -> None:
        kept = self.topics.setdefault(received.key, [])
        if len(kept) < _KEPT:
            kept.append(received)

    def _keep_bare(self, key: str, payload: bytes) -> None:
        self._keep(Received(key, _header("received", 0), payload))


Bytes = tuple[bytes, bytes]
"""An encoded header and payload."""

Spoiler = Callable[[random.Random, Received, int], Bytes]
"""Makes the n-th message of its sort from a received message."""


def _noise(rng: random.Random, received: Received, _: int) -> Bytes:
    whole = received.header.encode(), received.payload
    noise = rng.randbytes(rng.randrange(200))
    return (noise, whole[1]) if rng.random() < 0.5 else (whole[0], noise)


def _flipped(rng: random.Random, received: Received, _: int) -> Bytes:
    return _flip(rng, received.header.encode()), _flip(rng, received.payload)


def _flip(rng: random.Random, whole: bytes) -> bytes:
    flipped = bytearray(whole)
    for _ in range(rng.randrange(3) if whole else 0):
        flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(8)
    return bytes(flipped)


def _cut(rng: random.Random, received: Received, _: int) -> Bytes:
    return received.header.encode(), received.payload[: rng.randrange(len(received.payload) + 1)]


def _of_another_version(rng: random.Random, received: Received, _: int) -> Bytes:
    version = {
        "version": rng.choice([0, _VERSION - 1, _VERSION + 1, -1, 2**40, str(_VERSION), None])
    }
    if rng.random() < 0.5:
        return _with(received.header.encode(), version), received.payload
    return received.header.encode(), _with(received.payload, version)


def _of_other_values(rng: random.Random, received: Received, _: int) -> Bytes:
    odd: list[Any] = [
        -1,
        2**64 - 1,
        float("nan"),
        float("inf"),
        None,
        "x",
        b"x",
        [],
        {},
        [[[]]],
        True,
    ]
    fields = _fields(received.payload)
    changed = {name: rng.choice(odd) for name in fields if rng.random() < 0.4}
    return _header("other values", 0).encode(), _with(received.payload, changed)


def _large(rng: random.Random, received: Received, _: int) -> Bytes:
    greedy = [
        bytes(_LARGE),
        b"\xdd" + struct.pack(">I", _LARGE) + b"\x80" * _LARGE,  # mappings, 64 bytes each
        b"\x91" * _LARGE,
        b"\xdd\xff\xff\xff\xff",
    ]
    return received.header.encode(), rng.choice(greedy)


def _replayed(rng: random.Random, received: Received, _: int) -> Bytes:
    return received.header.encode(), received.payload


def _out_of_order(rng: random.Random, received: Received, number: int) -> Bytes:
    sequence = max(0, number + rng.randrange(-40, 40))
    return _header("out of order", sequence).encode(), received.payload


def _of_the_future(rng: random.Random, received: Received, number: int) -> Bytes:
    sequence = min(2**48 - 1, 2 ** rng.randrange(48) + number)
    return _header("the future", sequence).encode(), received.payload


def _of_many_streams(rng: random.Random, received: Received, number: int) -> Bytes:
    return _header(f"stream {number}", 0).encode(), received.payload


def _end(rng: random.Random, received: Received, number: int) -> Bytes:
    stream = rng.choice(["received", f"ended {number}"])
    header = _header(stream, rng.choice([0, number, 2**48 - 1]), end=True)
    return header.encode(), rng.choice([b"", received.payload])


def _bundle(rng: random.Random, received: Received, _: int) -> Bytes:
    headers = [received.header.encode()] * rng.randrange(70)
    payloads = [received.payload] * rng.choice([len(headers), rng.randrange(70)])
    together: Bytes = msgpack.packb(headers), msgpack.packb(payloads)
    return together if rng.random() < 0.5 else (_flip(rng, together[0]), together[1])


SPOILERS: Mapping[str, Spoiler] = {
    "noise": _noise,
    "flipped bits": _flipped,
    "cut": _cut,
    "another version": _of_another_version,
    "other values": _of_other_values,
    "large": _large,
    "replayed": _replayed,
    "out of order": _out_of_order,
    "the future": _of_the_future,
    "many streams": _of_many_streams,
    "end of no stream": _end,
    "bundle": _bundle,
}


def _header(stream: str, sequence: int, *, end: bool = False) -> Header:
    return Header(stream=stream, sequence=sequence, stamp_ns=0, end=end)


def _fields(packed: bytes) -> dict[str, Any]:
    try:
        fields = msgpack.unpackb(packed)
    except ValueError:
        return {}
    return fields if isinstance(fields, dict) else {}


def _with(packed: bytes, changes: dict[str, Any]) -> bytes:
    """Change fields of a message; a message without fields gets only the changes."""
    changed: bytes = msgpack.packb(_fields(packed) | changes)
    return changed


class _Written(Header):
    """Any bytes in place of a header."""

    stream: str = "written"
    sequence: int = 0
    stamp_ns: int = 0
    written: bytes

    def encode(self) -> bytes:
        """Return the bytes."""
        return self.written


def messages(
    received: Mapping[str, list[Received]], sort: str, count: int, seed: int
) -> Iterator[tuple[str, Bytes]]:
    """Yield so many messages of one sort, with their keys, evenly over all topics.

    Args:
        received: messages of every topic, as ``ReceivedTraffic`` has them.
        sort: a key of ``SPOILERS``.
        count: number of messages.
        seed: seed of the random choices.
    """
    rng = random.Random(f"{seed} {sort}")
    topics = sorted(received)
    for number in range(count):
        key = topics[number % len(topics)]
        yield key, SPOILERS[sort](rng, rng.choice(received[key]), number)


def publish(
    bus: Bus,
    received: Mapping[str, list[Received]],
    count: int,
    seed: int,
    sorts: Iterable[str] = SPOILERS,
) -> Counter[tuple[str, str]]:
    """Publish so many messages of every sort; return the number by topic and sort."""
    publishers = {key: bus.publisher(key) for key in received}
    published: Counter[tuple[str, str]] = Counter()
    for sort in sorts:
        for key, (header, payload) in messages(received, sort, count, seed):
            publishers[key].send(_Written(written=header), payload)
            published[key, sort] += 1
    return published


def declare_unknown_services(bus: Bus, keys: Keys) -> None:
    """Declare liveliness tokens of services that do not exist, until the session ends."""
    for service in ("channel", "featurizer!", "unknown"):
        for name in _ODD_NAMES:
            bus.declare_alive(keys.alive(service, name))


def query(bus: Bus, key: str, count: int, seed: int) -> Iterator[Bytes]:
    """Send so many malformed queries under a key; yield the replies, if there are any."""
    rng = random.Random(seed)
    for number in range(count):
        asked = [
            rng.randbytes(40),
            b"",
            b"\x91" * 999,
            _with(b"", {"version": _VERSION, "first": -1}),
        ]
        yield from bus.ask(key, asked[number % len(asked)], timeout_s=0.5)
