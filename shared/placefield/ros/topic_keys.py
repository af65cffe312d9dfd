"""The keys of ROS 2 on Zenoh, as its rmw_zenoh spells them (jazzy and later).

A topic's messages go on ``DOMAIN/TOPIC/TYPE/HASH``. Who is there is said by liveliness tokens, one
for a node and one for each of its topics, from which ``ros2 topic list`` and its like are answered.
"""

import re
import struct
from dataclasses import dataclass
from typing import Literal

from placefield.errors import ConfigError

_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_ROOT = "%"  # what stands for the slash inside a token
_QOS = "::,10:,:,:,,"  # reliable, volatile, the last 10 kept; all else as ROS has it

GID_BYTES = 16

Use = Literal["MP", "MS"]
"""What a node does with a topic: publishes on it, or subscribes to it."""


def topic_key(domain: int, topic: str, kind: str = "*", type_hash: str = "*") -> str:
    """Return the key of a topic's messages.

    Args:
        domain: of ROS.
        topic: with its leading slash.
        kind: of messages, as ``sensor_msgs/msg/Image``, or ``*`` for any.
        type_hash: of that kind, as ``RIHS01_...``, or ``*`` for any.
    """
    return f"{domain}{topic}/{_dds_type(kind)}/{type_hash}"


def kind_of_key(key: str) -> str:
    """Return the kind of the messages on such a key, as ``sensor_msgs/msg/Image``."""
    dds_type = key.rsplit("/", 2)[-2]
    return dds_type.replace("::dds_::", "::").removesuffix("_").replace("::", "/")


def _dds_type(kind: str) -> str:
    if kind == "*":
        return kind
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def check_topic(topic: str) -> str:
    """Return the topic, if ROS can have one of that name.

    Raises:
        ConfigError: it cannot.
    """
    if not _TOPIC.fullmatch(topic):
        raise ConfigError(f"topic {topic!r}: ROS has none of such a name; write /camera/image_raw")
    return topic


def check_name(run: str) -> str:
    """Return the run's name, if a node of ROS can have it.

    Raises:
        ConfigError: it cannot.
    """
    if not _NAME.fullmatch(run):
        raise ConfigError(
            f"run {run!r}: ROS has no such names; give letters, digits and _, a letter first"
        )
    return run


@dataclass(frozen=True)
class Node:
    """A node of ROS, the only one of its session.

    Attributes:
        domain: of ROS.
        session: identity of the Zenoh session that it lives in.
        namespace: with its leading slash.
        name: in that namespace.
    """

    domain: int
    session: str
    namespace: str
    name: str

    @property
    def token(self) -> str:
        """Its liveliness token."""
        return self._token(0, "NN")

    def topic_token(self, number: int, use: Use, topic: str, kind: str, type_hash: str) -> str:
        """Return the token of one of its topics, which it numbers from 1."""
        parts = _mangled(topic), _dds_type(kind), type_hash, _QOS
        return "/".join((self._token(number, use), *parts))

    def _token(self, number: int, what: str) -> str:
        lead = f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{what}"
        return f"{lead}/{_ROOT}/{_mangled(self.namespace)}/{self.name}"


def _mangled(name: str) -> str:
    return name.replace("/", _ROOT)


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Return what travels beside each message: Zenoh's serialisation of these three.

    Args:
        sequence: of the publisher's messages, from 1.
        stamp_ns: when it was published, nanoseconds.
        gid: of the publisher, ``GID_BYTES`` that no other has.
    """
    return struct.pack(f"<qqB{GID_BYTES}s", sequence, stamp_ns, GID_BYTES, gid)
