"""Compares the keys with an independent implementation of those of rmw_zenoh."""

import pytest
from zenoh_ros2_sdk.attachment import Attachment
from zenoh_ros2_sdk.entity import EndpointEntity, EntityKind, NodeEntity
from zenoh_ros2_sdk.keyexpr import (
    endpoint_liveliness_keyexpr,
    node_liveliness_keyexpr,
    topic_keyexpr,
)
from zenoh_ros2_sdk.qos import QosProfile

from placefield.errors import ConfigError
from placefield.ros.topic_keys import (
    Node,
    Use,
    attachment,
    check_name,
    check_topic,
    kind_of_key,
    topic_key,
)

TOPIC, KIND = "/camera/image_raw", "sensor_msgs/msg/Image"
DDS = "sensor_msgs::msg::dds_::Image_"
NODE = Node(7, "1a2b", "/placefield", "default")
THEIRS = NodeEntity(7, "1a2b", 0, "default", "/placefield")


def test_a_topic_s_key_says_its_type() -> None:
    key = topic_key(7, TOPIC, KIND, "RIHS01_ab")
    assert key == topic_keyexpr(7, TOPIC, DDS, "RIHS01_ab")
    assert kind_of_key(key) == KIND


def test_a_topic_of_any_type_is_a_key_expression() -> None:
    assert topic_key(0, TOPIC) == "0/camera/image_raw/*/*"
    assert topic_key(0, TOPIC, KIND) == f"0/camera/image_raw/{DDS}/*"


def test_a_node_s_token_is_theirs() -> None:
    assert NODE.token == node_liveliness_keyexpr(THEIRS)


@pytest.mark.parametrize(
    ("use", "theirs"), [("MP", EntityKind.PUBLISHER), ("MS", EntityKind.SUBSCRIPTION)]
)
def test_a_topic_s_token_is_theirs(use: Use, theirs: EntityKind) -> None:
    qos = QosProfile().encode()
    entity = EndpointEntity(THEIRS, 3, theirs, TOPIC, DDS, "RIHS01_ab", qos)
    token = NODE.topic_token(3, use, TOPIC, KIND, "RIHS01_ab")
    assert token == endpoint_liveliness_keyexpr(entity)


def test_an_attachment_is_theirs() -> None:
    gid = bytes(range(16))
    assert attachment(1, -1, gid) == Attachment(1, 2**64 - 1, gid).to_bytes()
    assert Attachment.from_bytes(attachment(5, 6, gid)) == Attachment(5, 6, gid)


@pytest.mark.parametrize("topic", ["/a", "/camera_1/image_raw/compressed", "/_hidden/x"])
def test_valid_topics_are_accepted(topic: str) -> None:
    assert check_topic(topic) == topic


@pytest.mark.parametrize(
    "topic", ["", "a", "/", "/a/", "//a", "/1a", "/a-b", "/**", "/a/*", "/a\n"]
)
def test_invalid_topics_are_refused(topic: str) -> None:
    with pytest.raises(ConfigError, match="not a valid name in ROS"):
        check_topic(topic)


@pytest.mark.parametrize("run", ["12", "a-b", "_a"])
def test_a_run_that_no_node_can_be_named_after_is_refused(run: str) -> None:
    assert check_name("default") == "default"
    with pytest.raises(ConfigError, match="not a valid name in ROS"):
        check_name(run)
