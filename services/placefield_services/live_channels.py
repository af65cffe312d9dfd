"""Which channels of a map can answer, from liveliness tokens."""

import threading
import time
from collections import defaultdict
from collections.abc import Callable

from placefield.bus.keys import Part, part_of, service_and_identity


class LiveChannels:
    """Which channels have a living worker, or one for each of their shards."""

    def __init__(self, count: int) -> None:
        self.all = range(count)
        self.alive: frozenset[int] = frozenset()
        """The channels that can answer now."""
        self._tokens: set[tuple[Part, str]] = set()
        self._changed = threading.Condition()

    def change(self, key: str, is_alive: bool) -> None:
        """Take the birth or death of a worker's token."""
        _, identity = service_and_identity(key)
        part = part_of(identity)
        if part is None:
            return
        with self._changed:
            (self._tokens.add if is_alive else self._tokens.discard)((part, identity))
            self.alive = _whole({part for part, _ in self._tokens})
            self._changed.notify_all()

    def wait_for_all(self, timeout: float, is_over: Callable[[], bool]) -> None:
        """Wait until every channel can answer, or it is over, at most ``timeout`` seconds."""
        end = time.monotonic() + timeout
        while not self.alive.issuperset(self.all) and not is_over():
            remaining = end - time.monotonic()
            if remaining <= 0:
                return
            with self._changed:
                self._changed.wait(min(remaining, 0.1))


def _whole(parts: set[Part]) -> frozenset[int]:
    """Return the channels all of whose shards are there."""
    shards: defaultdict[tuple[int, int], set[int]] = defaultdict(set)
    for part in parts:
        shards[part.channel, part.shards].add(part.shard)
    return frozenset(channel for (channel, count), there in shards.items() if len(there) == count)
