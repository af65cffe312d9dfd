"""Resampled traverses: a source's frames in the order of a simulated drive."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError, SourceError
from placefield.evaluation.protocols import DEFAULT_EVERY, Protocol, Resampling, drive_of
from placefield.features.frames import Frame
from placefield.features.images import decode
from placefield_tools.sources.source import Source

SENSOR_NOISE = 2.0
"""Standard deviation of the noise of a repeated frame, grey levels: a camera in fair light."""

JPEG_QUALITY = 90
"""JPEG quality of a repeated frame."""

_NOMINAL_NS = 100_000_000  # from frame to frame, if the query's stamps do not ascend


class ResampledTraverse(Source):
    """The frames of a query, and of another route, in the order of a simulated drive.

    The frames are renumbered, and stamped evenly at the query's mean rate, so that time also
    ascends where the drive turns back or jumps. All frames are held in memory, encoded.

    The odometry is the drive's own, if it has one. Otherwise it adds up the distances between
    consecutive frames, forwards or backwards. A jump to another position counts no distance.

    A frame is repeated while the vehicle is stationary. A repeated frame gets Gaussian noise of
    deviation ``SENSOR_NOISE`` in every pixel and colour, and becomes a JPEG of quality
    ``JPEG_QUALITY``. The same seed gives the same noise. A descriptor is repeated as it is.

    Attributes:
        drive: the simulated drive.
        query_count: number of frames of the query in its own order.
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
        """Read all frames of the query, and of the other route if there is one.

        See ``drive_of`` for protocol, seed and every.

        Raises:
            SourceError: a source is live, or fails, or one has images and the other descriptors.
            ValueError: see ``drive_of``.
        """
        self._query = _held(query)
        self._other = [] if other is None else _held(other)
        self.origin = query.origin
        self.dimensions = query.dimensions
        self.calibration = query.calibration
        if other is not None and other.dimensions != query.dimensions:
            raise SourceError(
                "query and other route are not alike; give images, or descriptors of one dimension"
            )
        self.not_given = query.not_given + (Counter() if other is None else other.not_given)
        self.query_count = len(self._query)
        self.drive: Resampling = drive_of(
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
            image = _with_noise(frame.image, [self._seed, index]) if repeated else frame.image
            odometry_m = self._odometry[index]
            yield replace(frame, index=index, stamp_ns=stamp_ns, image=image, odometry_m=odometry_m)

    def _readings(self) -> list[float | None]:
        """Return the odometry at each frame, metres; None where unknown."""
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
        raise SourceError("a camera cannot be resampled; record it and give the recording")
    return [replace(frame, image=_encoded(frame.image)) for frame in source]


def _with_noise(image: bytes | NDArray[np.uint8], seed: list[int]) -> bytes:
    """Return an image with sensor noise; data that are no image are returned unchanged."""
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
    """Encode pixels as PNG, which is lossless."""
    return image if isinstance(image, bytes) else cv2.imencode(".png", image)[1].tobytes()
