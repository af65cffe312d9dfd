"""A video file as a source of frames."""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.sources.capture import quiet_opencv, retrieve
from placefield_tools.sources.completeness import Completeness
from placefield_tools.sources.source import Source, until

log = logging.getLogger(__name__)

_MOST_DAMAGED = 1000
"""Consecutive frames that fail to decode before the rest of the video is given up."""

# FFmpeg would play a text file as an animation.
_TEXT = cv2.VideoWriter.fourcc(*"ansi")


class Video(Source):
    """The frames of a video, decoded by FFmpeg to (H, W, 3) BGR, stamped by its container.

    They are rotated as the container says, like images by their EXIF data.
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
            total = max(0, int(capture.get(cv2.CAP_PROP_FRAME_COUNT)))
        self.count = len(range(start, total, stride)) or None

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; all are read from the first on, because seeking is often inexact.

        A frame in the middle that does not decode is yielded with a ``fault``.
        """
        index = None
        with self._capture() as capture:
            expected = self._expected(capture)
            codec = _name(int(capture.get(cv2.CAP_PROP_FOURCC)))
            for index, stamp_ns, is_there in self._grabbed(capture):
                expected.note(stamp_ns)
                if index >= self._start and (index - self._start) % self._stride == 0:
                    pixels = retrieve(capture) if is_there else None
                    yield self._frame(index, stamp_ns, pixels)
        given = 0 if index is None else index + 1
        if self._stop and self._stop.is_set():
            return
        if not given:
            raise SourceError(
                f"{self._path}: no frame decodes: OpenCV has no decoder for its codec, {codec}, or "
                f"it is damaged; convert it: ffmpeg -i {self._path.name} -c:v libx264 NEW.mp4"
            )
        if given <= self._start:
            raise SourceError(f"--start {self._start}: {self._path} ends before this frame")
        self.not_given["missing"] = missing = expected.missing(given)
        if missing:
            log.warning(
                "%s: %d frames were read and %d are missing: it is damaged, cut off or trimmed",
                self._path,
                given,
                missing,
            )

    def _expected(self, capture: cv2.VideoCapture) -> Completeness:
        total = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        return Completeness(self._path, total, capture.get(cv2.CAP_PROP_FPS))

    def _grabbed(self, capture: cv2.VideoCapture) -> Iterator[tuple[int, int, bool]]:
        """Grab all frames up to the last that decodes; yield number, stamp, and whether it decodes.

        The stamps of frames that do not decode are interpolated.
        """
        in_vain = before_ns = 0
        for number in until(self._stop, count()):
            if capture.grab():
                stamp_ns = round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
                step_ns = (stamp_ns - before_ns) // (in_vain + 1)
                for bad in range(in_vain):
                    yield number - in_vain + bad, before_ns + (bad + 1) * step_ns, False
                yield number, stamp_ns, True
                in_vain, before_ns = 0, stamp_ns
            elif in_vain == _MOST_DAMAGED:
                return
            else:
                in_vain += 1

    def _frame(self, index: int, stamp_ns: int, pixels: NDArray[np.uint8] | None) -> Frame:
        name = f"{self._path.name}#{index}"
        if pixels is None:
            return Frame(index, stamp_ns, name, b"", fault="it does not decode")
        return Frame(index, stamp_ns, name, pixels)

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
    """Return the four characters of a codec; characters that cannot be printed become dots."""
    return "".join(chr(byte) if 32 < byte < 127 else "." for byte in fourcc.to_bytes(4, "little"))
