"""A ROS 2 node on the bus, for ROS processes that use ``rmw_zenoh``."""

import itertools
import time
import uuid
from collections.abc import Callable

from placefield.bus.session import Bus
from placefield.ros.ros_messages import type_hash
from placefield.ros.topic_keys import Node, attachment, kind_of_key, topic_key


class RosPublisher:
    """Publishes CDR messages on one topic; they are dropped when the link is congested."""

    def __init__(self, bus: Bus, key: str) -> None:
        self._bus = bus
        self._key = key
        self._gid = uuid.uuid4().bytes
        self._sequences = itertools.count(1)

    def put(self, payload: bytes) -> None:
        """Send a message."""
        beside = attachment(next(self._sequences), time.time_ns(), self._gid)
        self._bus.put_raw(self._key, payload, beside)


class RosNode:
    """A node and its topics, visible to ROS as long as the session lives."""

    def __init__(self, bus: Bus, domain: int, namespace: str, name: str) -> None:
        self._bus = bus
        self._node = Node(domain, bus.identity, namespace, name)
        self._numbers = itertools.count(1)
        bus.declare_alive(self._node.token)

    def publisher(self, topic: str, kind: str) -> RosPublisher:
        """Announce that this node publishes on a topic, and return the publisher."""
        known_as = type_hash(kind)
        self._bus.declare_alive(
            self._node.topic_token(next(self._numbers), "MP", topic, kind, known_as)
        )
        return RosPublisher(self._bus, topic_key(self._node.domain, topic, kind, known_as))

    def subscribe(self, topic: str, kind: str, receive: Callable[[str, bytes], None]) -> None:
        """Call ``receive(kind, payload)`` for each message on a topic, on the bus's thread.

        Messages of another kind are passed on, too, so that ``receive`` can report them.
        """
        self._bus.subscribe_raw(
            topic_key(self._node.domain, topic),
            lambda key, payload: receive(kind_of_key(key), payload),
        )
        self._bus.declare_alive(
            self._node.topic_token(next(self._numbers), "MS", topic, kind, type_hash(kind))
        )
