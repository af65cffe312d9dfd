"""Publishes the matches, or the smoothed matches, of a run as poses of ROS 2."""

from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.bus.ros_node import RosPublisher
from placefield.errors import MessageError
from placefield.ros.covariance import pose_covariance
from placefield.ros.ros_messages import pose_message

FRAME = "map"
"""The coordinate frame of the poses in ROS."""


class MapPoses(NamedTuple):
    """The poses of one map's places.

    Attributes:
        poses: (K, 3) x and y in metres and yaw in radians; NaN where a place has none.
        tolerance: how many places a known match may be off.
        digest: of the map.
    """

    poses: NDArray[np.float64]
    tolerance: int
    digest: str


class Poses:
    """Publishes the poses of known matches, and counts them as ``poses``, or ``smoothed_poses``."""

    def __init__(
        self,
        of_map: MapPoses,
        publisher: RosPublisher,
        counts: Counter[str],
        *,
        smoothed: bool = False,
    ) -> None:
        """Publish poses of one map's matches.

        Args:
            of_map: the poses of the map's places.
            publisher: of the topic.
            counts: of the run.
            smoothed: whether the matches are smoothed matches.
        """
        self._kind = SmoothedMessage if smoothed else MatchMessage
        self._current = of_map
        self._next: MapPoses | None = None
        self._publisher = publisher
        self._counts = counts

    def offer(self, of_map: MapPoses) -> None:
        """Take the poses of a new version of the map, for when its matches come."""
        self._next = of_map

    def publish(self, header: Header, data: bytes) -> None:
        """Publish the pose of a match with the stamp of its frame, if the match is known.

        Raises:
            MessageError: the message is no match of this map.
        """
        if header.end:
            return
        match = self._kind.decode(data)
        if self._next is not None and match.map == self._next.digest:
            self._current, self._next = self._next, None
        poses, tolerance, digest = self._current
        match.check_map(digest)
        if not match.known or match.probability is None or match.pose is None:
            return
        if not 0 <= match.place < len(poses):
            raise MessageError(
                f"a match of another map: place {match.place} of {len(poses)} places"
            )
        if not np.isfinite(poses[match.place]).all():
            raise MessageError(f"a match of another map: place {match.place} has no pose here")
        covariance = pose_covariance(poses, match.place, tolerance, match.probability)
        self._publisher.put(pose_message(header.stamp_ns, FRAME, match.pose, covariance))
        if self._kind is SmoothedMessage:
            self._counts["smoothed_poses"] += 1
        else:
            self._counts["poses"] += 1
