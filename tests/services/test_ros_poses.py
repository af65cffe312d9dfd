from collections import Counter

import numpy as np
import pytest
from bus_doubles import header
from ros_doubles import RecordingTopic

from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.errors import MessageError, OtherMapError
from placefield.maps.digest import NO_DIGEST
from placefield.ros.covariance import pose_covariance
from placefield.ros.ros_messages import POSE
from placefield_services.ros_poses import MapPoses, Poses

PLACES = np.stack([np.arange(20.0), np.zeros(20), np.full(20, np.pi)], axis=1)
TOLERANCE = 2
KNOWN = MatchMessage(
    map=NO_DIGEST, place=7, score=1.0, probability=0.995, known=True, pose=(7.0, 0.0, float(np.pi))
)


class Stage:
    """A publisher of poses with its published messages and its counts."""

    def __init__(self) -> None:
        self.topic = RecordingTopic(POSE)
        self.counts: Counter[str] = Counter()
        self._poses = Poses(MapPoses(PLACES, TOLERANCE, NO_DIGEST), self.topic, self.counts)

    def publish(self, **changes: object) -> None:
        self._poses.publish(header(5), KNOWN.model_copy(update=changes).encode())


@pytest.fixture
def stage() -> Stage:
    return Stage()


def test_a_known_match_is_a_pose_in_the_map(stage: Stage) -> None:
    stage.publish()
    (sent,) = stage.topic.sent
    assert (sent.header.stamp.sec, sent.header.stamp.nanosec) == (0, 5)
    assert sent.header.frame_id == "map"
    at = sent.pose.pose
    assert (at.position.x, at.position.y, at.position.z) == (7, 0, 0)
    assert (at.orientation.z, at.orientation.w) == pytest.approx((1, 0))
    expected = pose_covariance(PLACES, 7, TOLERANCE, 0.995)
    assert np.array_equal(sent.pose.covariance.reshape(6, 6), expected)
    assert stage.counts == {"poses": 1}


@pytest.mark.parametrize(
    "changes",
    [{"known": False}, {"known": None, "probability": None}, {"place": -1, "pose": None}],
)
def test_a_match_that_is_not_known_has_no_pose(stage: Stage, changes: dict[str, object]) -> None:
    stage.publish(**changes)
    assert not stage.topic.sent


def test_the_end_of_a_stream_is_no_pose(stage: Stage) -> None:
    stage._poses.publish(header(5, end=True), b"")
    assert not stage.topic.sent


def test_a_match_of_a_larger_map_is_malformed(stage: Stage) -> None:
    with pytest.raises(MessageError, match="another map"):
        stage.publish(place=20)


def test_a_match_with_a_pose_where_this_map_has_none_is_malformed(stage: Stage) -> None:
    gappy = PLACES.copy()
    gappy[7] = np.nan
    poses = Poses(MapPoses(gappy, TOLERANCE, NO_DIGEST), stage.topic, stage.counts)
    with pytest.raises(MessageError, match="place 7 has no pose"):
        poses.publish(header(5), KNOWN.encode())
    assert not stage.topic.sent


def test_a_smoothed_match_is_a_pose_too(stage: Stage) -> None:
    smoothed = SmoothedMessage(**KNOWN.model_dump(), lag=7)
    poses = Poses(MapPoses(PLACES, TOLERANCE, NO_DIGEST), stage.topic, stage.counts, smoothed=True)
    poses.publish(header(5), smoothed.encode())
    stage.publish()
    assert str(stage.topic.sent[0]) == str(stage.topic.sent[1])
    assert stage.counts == {"poses": 1, "smoothed_poses": 1}


def test_a_match_of_another_map_has_no_pose_here() -> None:
    stage = Stage()
    with pytest.raises(OtherMapError):
        stage.publish(map="f" * 16)
    assert not stage.topic.sent
