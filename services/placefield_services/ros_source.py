"""Streams the images of a ROS 2 topic as the live source of a run's frames."""

import logging
import uuid
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from placefield.bus.message import Header
from placefield.bus.messages import FrameMessage, OdometryMessage
from placefield.bus.replay_cache import CachedPublisher
from placefield.errors import MessageError
from placefield.features.calibration import Calibration
from placefield.features.distance_sampler import DistanceSampler
from placefield.ros.ros_messages import read_calibration, read_image, read_position

log = logging.getLogger(__name__)

_FARTHEST_M = 1e8  # farther positions are wrong, and rounding would lose the metres of a drive


class RosSource:
    """One live stream of frames, from the first image until the end, and the vehicle's odometry.

    Counts ``frames``, and as ``left_out`` the images between the spaced ones and the images before
    the first odometry.
    """

    def __init__(
        self,
        frames: CachedPublisher,
        put_odometry: Callable[[OdometryMessage], None],
        counts: Counter[str],
        spacing: DistanceSampler | None = None,
        calibration: Calibration | None = None,
    ) -> None:
        self._frames = frames
        self._put_odometry = put_odometry
        self._counts = counts
        self._spacing = spacing
        self._calibration = calibration
        self._stream = uuid.uuid4().hex
        self._sent = 0
        self._stamp_ns = 0
        self._metres = 0.0
        self._position: NDArray[np.float64] | None = None
        self._is_published = True
        """Whether a frame was published with the current metres."""

    def publish_image(self, kind: str, data: bytes) -> None:
        """Publish an image as the next frame with the stamp of its header, if the spacing uses it.

        The frame has the metres travelled only if odometry has come since the previous frame. So a
        vehicle whose odometry has stopped does not look like a stationary vehicle.

        Raises:
            MessageError: the message is no image, or its encoding is not supported.
        """
        stamp_ns, image = read_image(kind, data)
        if not self._is_due():
            self._counts["left_out"] += 1
            return
        self._stamp_ns = stamp_ns
        odometry_m = None if self._is_published else self._metres
        message = FrameMessage(image=image, odometry_m=odometry_m, calibration=self._calibration)
        self._frames.put(self._header(), message)
        self._is_published = True
        self._sent += 1
        self._counts["frames"] += 1

    def receive_calibration(self, kind: str, data: bytes) -> None:
        """Take the calibration of the camera for the next images.

        Raises:
            MessageError: the message says none.
        """
        self._calibration = read_calibration(kind, data)

    def _is_due(self) -> bool:
        if self._spacing is None:
            return True
        if self._position is None:
            if not self._counts["left_out"]:
                log.warning("images are left out until odometry comes: --spacing needs it")
            return False
        return self._spacing.is_due(self._metres)

    def publish_odometry(self, kind: str, data: bytes) -> None:
        """Add the distance from the last position, and publish the metres travelled so far.

        Raises:
            MessageError: the message is no odometry, or its position is not plausible.
        """
        position = read_position(kind, data)[:2]  # in the plane, as of recordings
        step = 0.0 if self._position is None else float(np.hypot(*(position - self._position)))
        if not max(step, *np.abs(position)) < _FARTHEST_M:
            raise MessageError(f"odometry at {position} m is too far away to be plausible")
        self._position, self._metres = position, self._metres + step
        self._is_published = False
        self._put_odometry(OdometryMessage(metres=self._metres))

    def end(self) -> None:
        """Publish the end of the stream, if the stream has begun."""
        if self._sent:
            self._frames.put(self._header(end=True))

    def _header(self, *, end: bool = False) -> Header:
        return Header(
            stream=self._stream,
            sequence=self._sent,
            stamp_ns=self._stamp_ns,
            live=True,
            end=end,
        )
