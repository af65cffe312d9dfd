"""A source's frames with the poses of a trajectory that was recorded beside them."""

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from placefield.errors import SourceError
from placefield.features.frames import Frame, Pose
from placefield.maps.geography import Origin
from placefield.maps.trajectory import Trajectory
from placefield_tools.sources.source import Derived, Source

log = logging.getLogger(__name__)


class Located(Derived):
    """The frames from a trajectory's first message to its last, each with its pose.

    A recorder's topics do not begin at one instant, and a SLAM's trajectory begins where it finds
    its way: what lies before and after has no place and is left out, which is logged, so that
    ``count`` is the most there are. A frame in a gap of the trajectory keeps its turn and has no
    pose, and so does one that was taken while a receiver had no fix.

    The metres along the poses are the frame's odometry, if it has no other: they are the longer,
    the more the poses jitter.
    """

    def __init__(
        self,
        source: Source,
        trajectory: Trajectory,
        name: str,
        *,
        key: Callable[[Frame], int] = lambda frame: frame.stamp_ns,
        origin: Origin | None = None,
        span_ns: tuple[int, int] | None = None,
    ) -> None:
        """Take the source and the trajectory.

        Args:
            source: of the frames.
            trajectory: where they were taken.
            name: of the trajectory, for a person.
            key: the instant of a frame in the trajectory.
            origin: of the trajectory.
            span_ns: stamps of the first and the last message, where some have no pose.
        """
        super().__init__(source)
        self.count = source.count
        self.origin = origin
        self._trajectory = trajectory
        self._name = name
        self._key = key
        self._span_ns = span_ns

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError where the trajectory covers none."""
        left_out = given = 0
        for frame in self._source:
            key = self._key(frame)
            if self._covers(key):
                given += 1
                yield self._located(frame, key)
            else:
                left_out += 1
        if not given:
            raise SourceError(
                f"{self._name}: none of the {left_out} frames was taken between its first pose and "
                "its last; do their stamps come from one clock?"
            )
        self.not_given["left out"] = left_out
        if left_out:
            log.warning(
                "%s: %d of %d frames were taken before its first pose or after its last: left out",
                self._name,
                left_out,
                left_out + given,
            )

    def _covers(self, key: int) -> bool:
        within = self._span_ns is not None and self._span_ns[0] <= key <= self._span_ns[1]
        return within or self._trajectory.covers(key)

    def _located(self, frame: Frame, key: int) -> Frame:
        x, y, yaw, metres = map(float, self._trajectory.at(np.array([key]))[0])
        if np.isnan(x):
            return replace(frame, pose=None)
        odometry_m = metres if frame.odometry_m is None else frame.odometry_m
        return replace(frame, pose=Pose(x, y, yaw), odometry_m=odometry_m)
