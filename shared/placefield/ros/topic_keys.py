"""The keys of ROS 2 topics on Zenoh, as rmw_zenoh spells them (jazzy and later).

A topic's messages go on ``DOMAIN/TOPIC/TYPE/HASH``. Each node has a liveliness token, and one for
each of its topics. Commands such as ``ros2 topic list`` read these tokens.
"""

import re
import struct
from dataclasses import dataclass
from typing import Literal

from placefield.errors import ConfigError

_TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_ROOT = "%"  # replaces the slash inside a token
_QOS = "::,10:,:,:,,"  # reliable, volatile, keeps the last 10; all else is the default of ROS

GID_BYTES = 16

Use = Literal["MP", "MS"]
"""How a node uses a topic: as publisher (``MP``) or as subscriber (``MS``)."""


def topic_key(domain: int, topic: str, kind: str = "*", type_hash: str = "*") -> str:
    """Return the key of a topic's messages.

    Args:
        domain: the ROS domain.
        topic: with its leading slash.
        kind: of messages, as ``sensor_msgs/msg/Image``, or ``*`` for any.
        type_hash: of that kind, as ``RIHS01_...``, or ``*`` for any.
    """
    return f"{domain}{topic}/{_dds_type(kind)}/{type_hash}"


def kind_of_key(key: str) -> str:
    """Return the kind of the messages on a topic's key, as ``sensor_msgs/msg/Image``."""
    dds_type = key.rsplit("/", 2)[-2]
    return dds_type.replace("::dds_::", "::").removesuffix("_").replace("::", "/")


def _dds_type(kind: str) -> str:
    if kind == "*":
        return kind
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def check_topic(topic: str) -> str:
    """Return the topic, if its name is valid in ROS.

    Raises:
        ConfigError: the name is not valid.
    """
    if not _TOPIC.fullmatch(topic):
        raise ConfigError(
            f"topic {topic!r}: not a valid name in ROS; write it as /camera/image_raw"
        )
    return topic


def check_name(run: str) -> str:
    """Return the run's name, if it is a valid name of a ROS node.

    Raises:
        ConfigError: the name is not valid.
    """
    if not _NAME.fullmatch(run):
        raise ConfigError(
            f"run {run!r}: not a valid name in ROS; give letters, digits and _, a letter first"
        )
    return run


@dataclass(frozen=True)
class Node:
    """A ROS node, the only one of its session.

    Attributes:
        domain: the ROS domain.
        session: identity of the node's Zenoh session.
        namespace: with its leading slash.
        name: of the node in that namespace.
    """

    domain: int
    session: str
    namespace: str
    name: str

    @property
    def token(self) -> str:
        """The liveliness token of the node."""
        return self._token(0, "NN")

    def topic_token(self, number: int, use: Use, topic: str, kind: str, type_hash: str) -> str:
        """Return the liveliness token of a topic of the node; ``number`` counts topics from 1."""
        parts = _mangled(topic), _dds_type(kind), type_hash, _QOS
        return "/".join((self._token(number, use), *parts))

    def _token(self, number: int, what: str) -> str:
        lead = f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{what}"
        return f"{lead}/{_ROOT}/{_mangled(self.namespace)}/{self.name}"


def _mangled(name: str) -> str:
    return name.replace("/", _ROOT)


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Return the attachment of a message: Zenoh's serialisation of the three arguments.

    Args:
        sequence: number of the message at its publisher, from 1.
        stamp_ns: when the message was published, nanoseconds.
        gid: identity of the publisher, unique, ``GID_BYTES`` long.
    """
    return struct.pack(f"<qqB{GID_BYTES}s", sequence, stamp_ns, GID_BYTES, gid)
