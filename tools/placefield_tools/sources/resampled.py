"""A source's frames in the order in which another drive would have taken them."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError, SourceError
from placefield.evaluation.protocols import DEFAULT_EVERY, Drive, Protocol, drive_of
from placefield.features.frames import Frame
from placefield.features.images import decode
from placefield_tools.sources.source import Source

SENSOR_NOISE = 2.0
"""Deviation of the noise of a frame that is taken again, grey levels: a camera in fair light."""

JPEG_QUALITY = 90
"""Of a frame that is taken again."""

_NOMINAL_NS = 100_000_000  # from frame to frame, where the query's stamps do not tell


class ResampledTraverse(Source):
    """The frames of a query, and of another route, as a drive takes them.

    They are numbered anew, and stamped evenly at the query's mean rate, so that time goes on where
    the drive turns back or jumps. All frames are held in memory, encoded.

    Their odometry is the drive's own, or else counts the metres that the frames' odometry is apart
    from one to the next, forth or back. Where the vehicle is carried elsewhere it counts none.

    A frame that is repeated, since the vehicle stands still, is not the same picture twice: it is
    decoded, gets Gaussian noise of a deviation of ``SENSOR_NOISE`` in every pixel and colour, and
    becomes a JPEG of quality ``JPEG_QUALITY``. The same seed gives the same noise.

    Attributes:
        drive: how they are taken.
        query_count: how many frames the query has in its own order.
    """

    def __init__(
        self,
        query: Source,
        protocol: Protocol,
        *,
        other: Source | None = None,
        seed: int,
        every: int = DEFAULT_EVERY,
    ) -> None:
        """Read the query, and the other route's frames where there are any.

        See ``drive_of`` for seed and every.

        Raises:
            SourceError: a source is live, or fails.
            ValueError: see ``drive_of``.
        """
        self._query = _held(query)
        self._other = [] if other is None else _held(other)
        self.origin = query.origin
        self.not_given = query.not_given + (Counter() if other is None else other.not_given)
        self.query_count = len(self._query)
        self.drive: Drive = drive_of(
            protocol, self.query_count, foreign_count=len(self._other), seed=seed, every=every
        )
        self._seed = seed
        self.count: int = len(self.drive.frames)
        self._step_ns = _mean_step_ns(self._query)
        self._odometry = self._readings()

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames."""
        drive = self.drive
        for index, (number, foreign, repeated) in enumerate(
            zip(drive.frames, drive.foreign, drive.repeated, strict=True)
        ):
            frame = (self._other if foreign else self._query)[number]
            stamp_ns = round(index * self._step_ns)
            image = _taken_again(frame.image, [self._seed, index]) if repeated else frame.image
            odometry_m = self._odometry[index]
            yield replace(frame, index=index, stamp_ns=stamp_ns, image=image, odometry_m=odometry_m)

    def _readings(self) -> list[float | None]:
        """Return the odometer's reading at each frame, metres; None where nobody knows."""
        drive = self.drive
        if drive.odometry is not None:
            return [*drive.odometry.tolist()]
        carried = {*drive.jumps.tolist(), *(np.flatnonzero(np.diff(drive.foreign)) + 1).tolist()}
        metres, before = 0.0, None
        readings: list[float | None] = []
        for index, (number, foreign) in enumerate(zip(drive.frames, drive.foreign, strict=True)):
            here = (self._other if foreign else self._query)[number].odometry_m
            before = None if index in carried else before
            if here is None:
                readings.append(None)
                continue
            metres += 0.0 if before is None else abs(here - before)
            readings.append(metres)
            before = here
        return readings


def _held(source: Source) -> list[Frame]:
    if source.live:
        raise SourceError("a camera cannot be driven again; record it and give the recording")
    return [replace(frame, image=_encoded(frame.image)) for frame in source]


def _taken_again(image: bytes | NDArray[np.uint8], seed: list[int]) -> bytes:
    """Return an image as the camera would take it once more; what is no image stays as it is."""
    encoded = _encoded(image)
    try:
        pixels = decode(encoded)
    except FrameError:
        return encoded
    noise = np.random.default_rng(seed).standard_normal(pixels.shape, np.float32)
    noisy = np.clip(np.rint(pixels + SENSOR_NOISE * noise), 0, 255).astype(np.uint8)
    return cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def _mean_step_ns(frames: list[Frame]) -> float:
    duration_ns = frames[-1].stamp_ns - frames[0].stamp_ns
    return duration_ns / (len(frames) - 1) if duration_ns > 0 else _NOMINAL_NS


def _encoded(image: bytes | NDArray[np.uint8]) -> bytes:
    """Encode pixels as PNG, which loses nothing."""
    return image if isinstance(image, bytes) else cv2.imencode(".png", image)[1].tobytes()
