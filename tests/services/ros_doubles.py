"""A test double of a ROS 2 topic."""

from typing import Any

from rosbags.typesys import Stores, get_typestore

from placefield.bus.ros_node import RosPublisher

_STORE = get_typestore(Stores.ROS2_JAZZY)


class RecordingTopic(RosPublisher):
    """Records the published messages of one kind."""

    def __init__(self, kind: str) -> None:
        self._kind = kind
        self.sent: list[Any] = []

    def put(self, payload: bytes) -> None:
        self.sent.append(_STORE.deserialize_cdr(payload, self._kind))
