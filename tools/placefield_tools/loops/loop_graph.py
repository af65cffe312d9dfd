"""The loops of a drive as a pose graph for g2o, GTSAM and others.

The vertices are the frames; the ID of a frame is its index in the source. The first one is fixed.
Edges lead from each frame to the next, and from an earlier frame to each frame that shows its
place, once smoothed. The latter say "the same pose"; the surer the answer, the greater their
information. If the camera is known, they have the relative pose of the two images instead: the yaw,
and also x and y if odometry gives the distance.

An edge from frame to frame is as good as what the drive knows of its motion. Poses are taken as
odometry with an error. An odometer gives the distance, and no direction. Without
either, every step is one unit long: the graph has the right loops, and no scale.
"""

import logging
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.fusion.uncertainty import pose_variances
from placefield.matching.exploring import Answer
from placefield_tools.loops.finding import DriveLoops
from placefield_tools.loops.loop_poses import loop_pose

log = logging.getLogger(__name__)

_SCALE = 0.05  # deviation of a step, as a fraction of its length
_LEAST = 0.02  # least deviation of a step, as a fraction of the mean step
_HEADING = 0.02  # deviation of the heading after a step between poses, radians
_UNKNOWN_HEADING = 0.5  # the same where no heading is known

Array = NDArray[np.float64]


class _Motion(NamedTuple):
    """What is known of a drive's motion.

    Attributes:
        poses: (Q, 3), x, y and yaw of each frame; along a straight line if no heading is known.
        along: deviation of a step's length, as a fraction of it.
        aside: the same across the direction of travel.
        heading: deviation of the heading after a step, radians.
    """

    poses: Array
    along: float
    aside: float
    heading: float


def to_graph(loops: DriveLoops) -> str:
    """Write the graph."""
    return "".join(f"{line}\n" for line in _lines(loops))


def _lines(loops: DriveLoops) -> Iterator[str]:
    motion, frames = _motion(loops), loops.frames
    for frame, pose in zip(frames, motion.poses, strict=True):
        yield f"VERTEX_SE2 {frame.number} {_numbers(*pose)}"
    steps = np.array([*map(_relative, motion.poses, motion.poses[1:])]).reshape(-1, 3)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    least = _LEAST * (float(lengths.mean()) if len(lengths) else 0.0) or _LEAST
    for number, (step, length) in enumerate(zip(steps, lengths, strict=True)):
        along, aside = (max(part * length, least) for part in (motion.along, motion.aside))
        ends = f"{frames[number].number} {frames[number + 1].number}"
        information = _information(along**2, aside**2, motion.heading**2)
        yield f"EDGE_SE2 {ends} {_numbers(*step)} {information}"
    for position, answer in enumerate(loops.smoothed):
        if answer.known:
            measured, covariance = _loop(loops, motion, position, answer)
            ends = f"{frames[answer.place].number} {frames[position].number}"
            upper = np.linalg.inv(covariance)[np.triu_indices(3)] + 0.0  # no -0
            yield f"EDGE_SE2 {ends} {_numbers(*measured)} {_numbers(*upper)}"
    yield f"FIX {frames[0].number}"  # last: GTSAM 4.3 reads no edge after a line it does not know


def _loop(loops: DriveLoops, motion: _Motion, position: int, answer: Answer) -> tuple[Array, Array]:
    """Return the measurement of a loop's edge, (3,), and its covariance, (3, 3)."""
    xy, yaw = pose_variances(motion.poses, answer.place, loops.tolerance, answer.probability)
    measured, covariance = np.zeros(3), np.diag([xy, xy, yaw])
    pose = None
    if loops.camera is not None:
        pose = loop_pose(loops.frames, answer.place, position, loops.camera)
    if pose is not None:
        measured[2], covariance[2, 2] = pose.turn.yaw, pose.turn.covariance[1, 1]
        return pose.cartesian() or (measured, covariance)
    return measured, covariance


def _motion(loops: DriveLoops) -> _Motion:
    """Return the best motion that all frames have; a part of them is not enough."""
    frames = loops.frames
    poses = [frame.pose for frame in frames if frame.pose is not None]
    metres = [frame.odometry_m for frame in frames if frame.odometry_m is not None]
    if len(poses) == len(frames):
        return _Motion(np.array(poses, np.float64), _SCALE, _SCALE, _HEADING)
    if len(metres) == len(frames):
        return _Motion(_straight(np.array(metres) - metres[0]), _SCALE, 1.0, _UNKNOWN_HEADING)
    for what, known in (("a pose", poses), ("a reading of the odometer", metres)):
        if known:
            log.warning(
                "%d of %d frames have %s: it is not used, because all need one",
                len(known),
                len(frames),
                what,
            )
    return _Motion(_straight(np.arange(len(frames))), 1.0, 1.0, _UNKNOWN_HEADING)


def _straight(along: NDArray[np.generic]) -> Array:
    return np.column_stack([along, np.zeros((len(along), 2))]).astype(np.float64)


def _relative(one: Array, other: Array) -> Array:
    """Return the pose of the second frame relative to the first, (3,)."""
    (x, y), yaw = (other - one)[:2], one[2]
    cosine, sine = math.cos(yaw), math.sin(yaw)
    turned = math.remainder(other[2] - yaw, math.tau)
    return np.array([cosine * x + sine * y, cosine * y - sine * x, turned])


def _information(along: float, aside: float, heading: float) -> str:
    """Return the upper triangle of the information matrix of these variances."""
    return f"{_numbers(1 / along)} 0 0 {_numbers(1 / aside)} 0 {_numbers(1 / heading)}"


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.9g}" for value in values)
