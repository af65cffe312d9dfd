"""Injects faults into a run: kills and stops services, and publishes bad messages."""

import random
import signal
import threading
from collections import Counter, deque

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.session import Bus
from placefield_tools.chaos.children import Children
from placefield_tools.chaos.garbage import ReceivedTraffic, publish
from placefield_tools.chaos.schedule import Fault

_KEPT = 256  # messages of all topics

_SORTS = ("noise", "cut", "another version", "large")
"""Garbage that names only the current stream. A new stream would end it: whoever may publish frames
may start a stream."""

_OF_EACH = 50
"""Messages of one sort in one burst, over all topics."""


class FaultInjector:
    """Injects scheduled faults into child processes and on their bus."""

    def __init__(self, children: Children, bus: Bus, keys: Keys) -> None:
        self._children = children
        self._bus = bus
        self._received = ReceivedTraffic(bus, keys)
        self._newest: deque[Received] = deque(maxlen=_KEPT)
        self._lock = threading.Lock()
        answers = keys.match, keys.smoothed, keys.ack
        for key in (keys.frame, keys.feature, keys.all_candidates, *answers):
            bus.subscribe(key, self._keep, Counter(), ends_empty=False)

    def _keep(self, received: Received) -> None:
        with self._lock:
            self._newest.append(received)

    def begin(self, fault: Fault) -> None:
        """Inject a fault, or begin one that lasts."""
        verb, _, services = fault.kind.partition(" ")
        if verb == "kill":
            for service in services.split(" and "):
                self._children.signal(self._one_of(service, fault), signal.SIGKILL)
        elif verb == "stop":
            self._children.signal(self._one_of(services, fault), signal.SIGSTOP)
        elif verb == "garbage":
            topics = dict(self._received.topics)
            publish(self._bus, topics, _OF_EACH, fault.draw, _SORTS)
        else:
            self._repeat(random.Random(fault.draw))

    def end(self, fault: Fault) -> None:
        """End a fault that lasts."""
        if fault.kind == "stop channel":
            self._children.signal(self._one_of("channel", fault), signal.SIGCONT)

    def _one_of(self, service: str, fault: Fault) -> str:
        names = self._children.names(service)
        return names[fault.draw % len(names)]

    def _repeat(self, rng: random.Random) -> None:
        """Publish the newest messages of all topics again, in any order."""
        with self._lock:
            again = list(self._newest)
        rng.shuffle(again)
        publishers = {key: self._bus.publisher(key) for key in {each.key for each in again}}
        for each in again:
            publishers[each.key].send(each.header, each.payload)
