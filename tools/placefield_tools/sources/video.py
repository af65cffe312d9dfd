"""A video file as a source of frames."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import cv2

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.sources.capture import grab_every, quiet_opencv, retrieve
from placefield_tools.sources.source import Source, until

# FFmpeg would play a text file as an animation.
_TEXT = cv2.VideoWriter.fourcc(*"ansi")


class Video(Source):
    """The frames of a video, decoded by FFmpeg to (H, W, 3) BGR, stamped by its container.

    They are turned as the container says, like images as their EXIF does.
    """

    def __init__(
        self,
        path: Path,
        *,
        start: int = 0,
        stride: int = 1,
        stop: threading.Event | None = None,
    ) -> None:
        self._path = path
        self._stop = stop
        self._start = start
        self._stride = stride
        with self._capture() as capture:
            total = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
            self.count = len(range(start, total, stride)) or None

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames, read from the first on: seeking is not exact in every container."""
        index = None
        with self._capture() as capture:
            numbers = until(self._stop, count())
            for index in grab_every(capture, numbers, self._start, self._stride):
                pixels = retrieve(capture)
                if pixels is None:
                    raise SourceError(f"{self._path}: frame {index} does not decode")
                stamp_ns = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
                yield Frame(index, stamp_ns, f"{self._path.name}#{index}", pixels)
            codec = _name(int(capture.get(cv2.CAP_PROP_FOURCC)))
        if index is None and self._start == 0 and not (self._stop and self._stop.is_set()):
            raise SourceError(
                f"{self._path}: no frame decodes; OpenCV has no decoder for its codec, {codec}, or "
                f"it is damaged: convert it: ffmpeg -i {self._path.name} -c:v libx264 NEW.mp4"
            )
        if index is None:
            raise SourceError(f"--start {self._start}: {self._path} ends before this frame")

    @contextmanager
    def _capture(self) -> Iterator[cv2.VideoCapture]:
        with quiet_opencv():
            capture = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG)
        try:
            if not capture.isOpened() or int(capture.get(cv2.CAP_PROP_FOURCC)) == _TEXT:
                raise SourceError(f"{self._path}: no video that FFmpeg reads; give another file")
            capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
            yield capture
        finally:
            capture.release()


def _name(fourcc: int) -> str:
    """Return the name of a codec by its four characters; those that cannot be printed are dots."""
    return "".join(chr(byte) if 32 < byte < 127 else "." for byte in fourcc.to_bytes(4, "little"))
