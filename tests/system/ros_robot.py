"""A robot that speaks ROS 2 over Zenoh, by a client that is not ours."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ros_definitions import DEFINITIONS, PARTS
from zenoh_ros2_sdk import ROS2Publisher, ROS2Subscriber, ZenohSession, get_topic_names_and_types
from zenoh_ros2_sdk.utils import compute_type_hash_from_msg


class Robot:
    """Publishes and receives whole ROS 2 messages, as dictionaries of their fields."""

    def __init__(self, session: ZenohSession, domain: int) -> None:
        self.session = session
        self._domain = domain
        self._open: list[Any] = []

    def publisher(self, topic: str, kind: str) -> ROS2Publisher:
        made = ROS2Publisher(topic, kind, **self._known(kind))
        self._open.append(made)
        return made

    def subscribe(self, topic: str, kind: str, receive: Callable[[Any], None]) -> None:
        self._open.append(ROS2Subscriber(topic, kind, receive, **self._known(kind)))

    def _known(self, kind: str) -> dict[str, Any]:
        for part, definition in PARTS[kind].items():
            self.session.register_message_type(definition, part)
        return {
            "msg_definition": DEFINITIONS[kind],
            "type_hash": compute_type_hash_from_msg(kind, DEFINITIONS[kind], PARTS[kind]),
            "domain_id": self._domain,
        }

    def made(self, kind: str, **fields: Any) -> Any:
        """Make a part of a message."""
        return self.session.store.types[kind](**fields)

    def topics(self) -> dict[str, list[str]]:
        """Return the topics that there are and their types, as ``ros2 topic list -t`` does."""
        return dict(get_topic_names_and_types(self._domain))

    def close(self) -> None:
        for made in self._open:
            made.close()


@contextmanager
def open_robot(endpoint: str, domain: int) -> Iterator[Robot]:
    """Connect to a router; the client knows one session of a process."""
    address, port = endpoint.removeprefix("tcp/").split(":")
    session = ZenohSession.get_instance(address, int(port))
    robot = Robot(session, domain)
    try:
        yield robot
    finally:
        robot.close()
        session.session.close()
        ZenohSession._instance = None
