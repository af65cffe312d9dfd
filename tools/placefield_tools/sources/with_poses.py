"""A source whose frames get poses from a recorded trajectory."""

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


class WithPoses(Derived):
    """The frames between the first and the last message of a trajectory, each with its pose.

    Frames before and after the trajectory are left out, which is logged: the topics of a recording
    do not begin at the same instant, and SLAM starts late. ``count`` is therefore an upper bound. A
    frame in a gap of the trajectory, or without a fix of the receiver, is kept and has no pose.

    A frame without odometry gets the metres along the poses, which jitter of the poses makes too
    long.
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
        """Join a source and a trajectory.

        Args:
            source: of the frames.
            trajectory: of the vehicle.
            name: of the trajectory, used in messages.
            key: gives the instant of a frame in the trajectory, nanoseconds.
            origin: georeference of the trajectory.
            span_ns: stamps of the first and the last message, if some messages have no pose.
        """
        super().__init__(source)
        self.count = source.count
        self.origin = origin
        self._trajectory = trajectory
        self._name = name
        self._key = key
        self._span_ns = span_ns

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError if the trajectory covers none."""
        left_out = given = 0
        for frame in self._source:
            key = self._key(frame)
            if self._covers(key):
                given += 1
                yield self._with_pose(frame, key)
            else:
                left_out += 1
        if not given:
            raise SourceError(
                f"{self._name}: none of the {left_out} frames was taken between its first and its "
                "last pose; check that both stamps come from one clock"
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

    def _with_pose(self, frame: Frame, key: int) -> Frame:
        x, y, yaw, metres = map(float, self._trajectory.at(np.array([key]))[0])
        if np.isnan(x):
            return replace(frame, pose=None)
        odometry_m = metres if frame.odometry_m is None else frame.odometry_m
        return replace(frame, pose=Pose(x, y, yaw), odometry_m=odometry_m)
