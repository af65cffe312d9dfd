"""Poses and positions in the messages of recordings, of ROS or Foxglove."""

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from placefield.errors import SourceError
from placefield.maps.geography import Origin
from placefield.maps.trajectory import Trajectory, directions
from placefield.ros.ros_messages import ODOMETRY, POSE
from placefield_tools.sources.degrees import is_fix, to_local_metres
from placefield_tools.sources.pose_axes import forwards_of, ground_poses
from placefield_tools.sources.pose_files import LARGEST
from placefield_tools.sources.recording import Recording, known_errors
from placefield_tools.sources.source import Source
from placefield_tools.sources.topics import pose_topic
from placefield_tools.sources.with_poses import WithPoses

log = logging.getLogger(__name__)

_ROS_FIX, _FOXGLOVE_FIX = "sensor_msgs/msg/NavSatFix", "foxglove.LocationFix"

_RECORDED_AXES = "give them as a file, with --poses and --pose-axes z-forward"

_Row = tuple[float, ...]


class RecordedTrajectory(NamedTuple):
    """A trajectory, its georeference if known, and the stamps of the first and last message."""

    trajectory: Trajectory
    origin: Origin | None
    span_ns: tuple[int, int]


def trajectory_of(name: str, kind: str, messages: Iterable[tuple[int, Any]]) -> RecordedTrajectory:
    """Return the trajectory of messages of one known type, given as pairs of stamp and message.

    With GPS fixes, the first fix is the origin, and the yaw is the direction of travel. Messages
    with a number that is not finite or absurdly large, and messages without a fix (by their status,
    or 0, 0), are left out; their number is logged.

    Raises:
        SourceError: no message is left.
    """
    rows = [(stamp_ns, *_READ[kind](message)) for stamp_ns, message in messages]
    valid = [row for row in rows if (np.abs(row[1:]) < LARGEST).all()]
    if not valid:
        raise SourceError(
            f"{name}: none of {len(rows)} messages has a position; "
            "choose another topic with --odometry-topic, or none"
        )
    if len(valid) < len(rows):
        log.warning("%s: %d of %d messages have a position", name, len(valid), len(rows))
    span_ns = int(min(row[0] for row in rows)), int(max(row[0] for row in rows))
    valid.sort(key=lambda row: row[0])
    stamps = np.array([row[0] for row in valid], np.int64)
    values = np.array([row[1:] for row in valid], np.float64)
    if kind not in (_ROS_FIX, _FOXGLOVE_FIX):
        forwards = forwards_of(values[:, 3:], "x-forward")
        poses = ground_poses(name, values[:, :3], forwards, "x-forward", _RECORDED_AXES)
        return RecordedTrajectory(Trajectory.of(stamps, poses), None, span_ns)
    origin, positions = to_local_metres(values)
    poses = np.column_stack([positions, directions(positions)])
    return RecordedTrajectory(Trajectory.of(stamps, poses), origin, span_ns)


def _of_pose(pose: Any) -> _Row:
    at, turn = pose.position, pose.orientation
    return at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w


def _of_fix(fix: Any) -> _Row:
    status = getattr(fix, "status", None)  # Foxglove's has none
    has_fix = status is None or status.status >= 0
    at = fix.latitude, fix.longitude
    return at if has_fix and is_fix(*at) else (np.nan, np.nan)


_OF_ROS: dict[str, Callable[[Any], _Row]] = {
    ODOMETRY: lambda message: _of_pose(message.pose.pose),
    POSE: lambda message: _of_pose(message.pose.pose),
    "geometry_msgs/msg/PoseStamped": lambda message: _of_pose(message.pose),
    _ROS_FIX: _of_fix,
}
_OF_FOXGLOVE: dict[str, Callable[[Any], _Row]] = {
    "foxglove.PoseInFrame": lambda message: _of_pose(message.pose),
    _FOXGLOVE_FIX: _of_fix,
}
_READ = _OF_ROS | _OF_FOXGLOVE

ROS_POSES, FOXGLOVE_POSES = tuple(_OF_ROS), tuple(_OF_FOXGLOVE)
"""The types of messages that hold poses or positions of the vehicle."""


def with_poses(source: Source, recordings: Sequence[Recording], asked: str | None) -> Source:
    """Add the poses of the recordings' odometry topic to the frames, if a topic is selected.

    Args:
        source: of the frames.
        recordings: the recordings of the drive, in order.
        asked: ``--odometry-topic``, see ``pose_topic``.

    Raises:
        SourceError: there is no such topic, or none of its messages has a position.
    """
    path = recordings[0].path
    types = {topic: kind for each in recordings for topic, kind in each.types.items()}
    kinds = {kind for each in recordings for kind in each.poses}
    topic = pose_topic(str(path), types, kinds, asked)
    if topic is None:
        return source
    name = f"{path.name}:{topic}"
    recorded = trajectory_of(name, types[topic], _messages(recordings, topic))
    return WithPoses(
        source, recorded.trajectory, name, origin=recorded.origin, span_ns=recorded.span_ns
    )


def _messages(recordings: Sequence[Recording], topic: str) -> Iterator[tuple[int, Any]]:
    for recording in recordings:
        if topic in recording.types:
            with known_errors(recording.path):
                yield from recording.messages(topic)
