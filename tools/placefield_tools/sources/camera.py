"""A camera, on this machine or on the network, as a source of frames."""

import itertools
import logging
import threading
import time
from collections.abc import Iterator

import cv2

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.sources.capture import grab_every, quiet_opencv, retrieve
from placefield_tools.sources.secrets import without_secrets
from placefield_tools.sources.source import Source

log = logging.getLogger(__name__)

_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 30.0

_TIMEOUT_MS = 5000
_TIMEOUTS = [
    *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _TIMEOUT_MS),
    *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, _TIMEOUT_MS),
]


class Camera(Source):
    """The frames of a camera, (H, W, 3) BGR, stamped when they arrive.

    If the camera gives no more frames, it is opened again until it is back or the source is
    stopped. The waits between attempts double up to 30 s. The log counts the reconnects.
    """

    live = True
    count = None

    def __init__(
        self,
        where: int | str,
        *,
        start: int = 0,
        stride: int = 1,
        stop: threading.Event | None = None,
    ) -> None:
        """Open a camera.

        Args:
            where: its number on this machine, or a URL (``rtsp://…``, ``http://…``).
            start: index of the first frame.
            stride: step from one frame to the next.
            stop: ends the frames, also while the camera is away; None: only ``close`` ends them.

        Raises:
            SourceError: the camera cannot be opened.
        """
        self._where = where
        self._name = f"camera:{where}" if isinstance(where, int) else without_secrets(where)
        self._start = start
        self._stride = stride
        self._stop = stop or threading.Event()
        self._is_closed = False
        self._returns = 0
        self._capture = _open(where)
        if not self._capture.isOpened():
            raise SourceError(
                f"{self._name}: cannot be opened; check that it is connected and free, "
                "and that you may read it"
            )

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames until the source is stopped; damaged frames are left out."""
        numbers = itertools.takewhile(lambda _: not self._is_over(), itertools.count())
        wait_s = _FIRST_WAIT_S
        while True:
            for index in grab_every(self._capture, numbers, self._start, self._stride):
                wait_s = _FIRST_WAIT_S
                stamp_ns = time.time_ns()
                pixels = retrieve(self._capture)
                if pixels is not None:
                    yield Frame(index, stamp_ns, f"{self._name}#{index}", pixels)
            self._capture.release()
            if self._is_over():
                return
            log.warning("%s: gives no more frames; reconnecting in %g s", self._name, wait_s)
            if self._stop.wait(wait_s):
                return
            wait_s = min(2 * wait_s, _LONGEST_WAIT_S)
            self._capture = _open(self._where)
            if self._capture.isOpened():
                self._returns += 1
                log.warning("%s: is back; reconnects so far: %d", self._name, self._returns)

    def close(self) -> None:
        """Release the camera; its frames end."""
        self._is_closed = True
        self._capture.release()

    def _is_over(self) -> bool:
        return self._is_closed or self._stop.is_set()


def _open(where: int | str) -> cv2.VideoCapture:
    with quiet_opencv():
        if isinstance(where, int):
            return cv2.VideoCapture(where)
        return cv2.VideoCapture(where, cv2.CAP_FFMPEG, _TIMEOUTS)
