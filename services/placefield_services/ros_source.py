"""A topic of ROS 2 as the live source of a run's frames."""

import uuid
from collections import Counter
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from placefield.bus.history import Outbox
from placefield.bus.messages import FrameMessage, Header, OdometryMessage
from placefield.ros.messages import read_image, read_position


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
        position = read_position(kind, data)
        if self._position is not None:
            self._metres += float(np.linalg.norm(position - self._position))
        self._position = position
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
