"""A topic of ROS 2 as the live source of a run's frames."""

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
from placefield.features.distance_sampler import DistanceSampler
from placefield.ros.messages import read_image, read_position

log = logging.getLogger(__name__)

_FARTHEST_M = 1e8  # above that the metres of a drive are lost in rounding, or it is not of earth


class RosSource:
    """One live stream of frames, from a first image until the end, and the vehicle's odometry.

    Counts ``frames``, and as ``left_out`` the images that a spacing does not take, or of which it
    is not known yet how far the vehicle has come.
    """

    def __init__(
        self,
        frames: CachedPublisher,
        tell_odometry: Callable[[OdometryMessage], None],
        counts: Counter[str],
        spacing: DistanceSampler | None = None,
    ) -> None:
        self._frames = frames
        self._tell_odometry = tell_odometry
        self._counts = counts
        self._spacing = spacing
        self._stream = uuid.uuid4().hex
        self._sent = 0
        self._stamp_ns = 0
        self._metres = 0.0
        self._position: NDArray[np.float64] | None = None
        self._is_told = True
        """Whether the metres went with a frame already."""

    def take_image(self, kind: str, data: bytes) -> None:
        """Publish an image as the next frame, with the stamp of its header, if it is to be taken.

        The metres travelled go with it, if odometry has come since the frame before: a vehicle
        whose odometry has stopped coming must not look like one that stands still.

        Raises:
            MessageError: it is none that we read.
        """
        stamp_ns, image = read_image(kind, data)
        if not self._takes():
            self._counts["left_out"] += 1
            return
        self._stamp_ns = stamp_ns
        odometry_m = None if self._is_told else self._metres
        self._frames.put(self._header(), FrameMessage(image=image, odometry_m=odometry_m))
        self._is_told = True
        self._sent += 1
        self._counts["frames"] += 1

    def _takes(self) -> bool:
        if self._spacing is None:
            return True
        if self._position is None:
            if not self._counts["left_out"]:
                log.warning("images are left out until odometry comes, to space them by")
            return False
        return self._spacing.is_due(self._metres)

    def take_odometry(self, kind: str, data: bytes) -> None:
        """Publish the metres travelled so far, from one position to the next.

        Raises:
            MessageError: it is no odometry.
        """
        position = read_position(kind, data)[:2]  # in the plane, as of recordings
        step = 0.0 if self._position is None else float(np.hypot(*(position - self._position)))
        if not max(step, *np.abs(position)) < _FARTHEST_M:
            raise MessageError(f"odometry at {position} m: too far away to be true")
        self._position, self._metres = position, self._metres + step
        self._is_told = False
        self._tell_odometry(OdometryMessage(metres=self._metres))

    def end(self) -> None:
        """Publish the end of the stream, if it has begun."""
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
