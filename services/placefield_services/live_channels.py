"""Tracks by liveliness tokens which channels of a map can answer."""

import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable

from placefield.bus.keys import Part, part_of, service_and_identity
from placefield.bus.session import MOST_TOKENS


class LiveChannels:
    """The channels that have a live worker, or a live worker for each of their shards."""

    def __init__(self, count: int) -> None:
        self.all = range(count)
        self.alive: frozenset[int] = frozenset()
        """The channels that can answer now."""
        self._tokens: set[tuple[Part, str]] = set()
        self._workers: Counter[Part] = Counter()
        self._shards: defaultdict[tuple[int, int], set[int]] = defaultdict(set)
        """The live shards of each channel and number of shards."""
        self._whole: set[tuple[int, int]] = set()
        self._changed = threading.Condition()

    def change(self, key: str, is_alive: bool) -> None:
        """Record that a worker's token has appeared or disappeared.

        At most ``MOST_TOKENS`` tokens are kept; more come from untrusted clients. The work does not
        grow with the number of tokens.
        """
        _, identity = service_and_identity(key)
        part = part_of(identity)
        if part is None or part.channel not in self.all:
            return
        with self._changed:
            token = part, identity
            if is_alive == (token in self._tokens):
                return
            if not is_alive:
                self._tokens.discard(token)
            elif len(self._tokens) < MOST_TOKENS:
                self._tokens.add(token)
            else:
                return
            self._workers[part] += 1 if is_alive else -1
            self._note(part)
            self._changed.notify_all()

    def _note(self, part: Part) -> None:
        """Update whether a part of a channel is alive, and whether the whole channel is."""
        cut = part.channel, part.shards
        is_there = self._workers[part] > 0
        (self._shards[cut].add if is_there else self._shards[cut].discard)(part.shard)
        is_whole = len(self._shards[cut]) == part.shards
        (self._whole.add if is_whole else self._whole.discard)(cut)
        self.alive = frozenset(channel for channel, _ in self._whole)
        if not is_there:
            del self._workers[part]
        if not self._shards[cut]:
            del self._shards[cut]

    def wait_for_all(self, timeout: float, is_over: Callable[[], bool]) -> None:
        """Wait until every channel can answer or ``is_over``, at most ``timeout`` seconds."""
        end = time.monotonic() + timeout
        while not self.alive.issuperset(self.all) and not is_over():
            remaining = end - time.monotonic()
            if remaining <= 0:
                return
            with self._changed:
                self._changed.wait(min(remaining, 0.1))
