"""A topic of ROS 2 as the live source of a run's frames."""

import uuid
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from placefield.bus.history import Outbox
from placefield.bus.messages import FrameMessage, Header, OdometryMessage
from placefield.errors import MessageError
from placefield.ros.messages import read_image, read_position

_FARTHEST_M = 1e8  # above that the metres of a drive are lost in rounding, or it is not of earth


class RosSource:
    """One live stream of frames, from a first image until the end, and the vehicle's odometry.

    Counts ``frames``.
    """

    def __init__(
        self,
        frames: Outbox,
        tell_odometry: Callable[[OdometryMessage], None],
        counts: Counter[str],
    ) -> None:
        self._frames = frames
        self._tell_odometry = tell_odometry
        self._counts = counts
        self._stream = uuid.uuid4().hex
        self._sent = 0
        self._stamp_ns = 0
        self._metres = 0.0
        self._position: NDArray[np.float64] | None = None

    def take_image(self, kind: str, data: bytes) -> None:
        """Publish an image as the next frame, with the stamp of its header.

        Raises:
            MessageError: it is none that we read.
        """
        self._stamp_ns, image = read_image(kind, data)
        self._frames.put(self._header(), FrameMessage(image=image))
        self._sent += 1
        self._counts["frames"] += 1

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
