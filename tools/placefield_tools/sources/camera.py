"""A camera on this machine as a source of frames."""

import time
from collections.abc import Iterator

import cv2

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.sources.capture import frame_rate, grab_every, quiet_opencv, retrieve
from placefield_tools.sources.source import Source


class Camera(Source):
    """The frames of camera number ``device``, (H, W, 3) BGR, stamped when they arrive."""

    live = True
    count = None

    def __init__(self, device: int, *, start: int = 0, stride: int = 1) -> None:
        self._name = f"camera:{device}"
        self._start = start
        self._stride = stride
        with quiet_opencv():
            self._capture = cv2.VideoCapture(device)
        if not self._capture.isOpened():
            raise SourceError(
                f"{self._name}: cannot be opened; is it plugged in, free, and yours to read?"
            )
        self.frame_rate = frame_rate(self._capture, stride)

    def __iter__(self) -> Iterator[Frame]:
        """Yield frames for as long as the camera gives them; a damaged one is left out."""
        for index in grab_every(self._capture, self._start, self._stride):
            stamp_ns = time.time_ns()
            pixels = retrieve(self._capture)
            if pixels is not None:
                yield Frame(index, stamp_ns, f"{self._name}#{index}", pixels)
        raise SourceError(f"{self._name}: gives no more frames; was it unplugged?")

    def close(self) -> None:
        """Give the camera back."""
        self._capture.release()
