"""A source's frames in the order in which another drive would have taken them."""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from placefield.errors import SourceError
from placefield.evaluation.protocols import Drive, Protocol, drive_of
from placefield.features.frames import Frame
from placefield_tools.sources.source import Source

_NOMINAL_NS = 100_000_000  # from frame to frame, where the query's stamps do not tell


class Driven(Source):
    """The frames of a query, and of another route, as a drive takes them.

    They are numbered anew, and stamped evenly at the query's mean rate, so that time goes on where
    the drive turns back or jumps; their odometry is left out. All frames are held in memory,
    encoded.

    Attributes:
        drive: how they are taken.
        undriven_count: how many frames the query has in its own order.
    """

    def __init__(
        self, query: Source, protocol: Protocol, *, other: Source | None = None, seed: int
    ) -> None:
        """Read the query, and the other route's frames where there are any.

        Raises:
            SourceError: a source is live, or fails.
            ValueError: see ``drive_of``.
        """
        self._query = _held(query)
        self._other = [] if other is None else _held(other)
        self.undriven_count = len(self._query)
        self.drive: Drive = drive_of(
            protocol, self.undriven_count, foreign_count=len(self._other), seed=seed
        )
        self.count: int = len(self.drive.frames)
        self._step_ns = _mean_step_ns(self._query)

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames."""
        for index, (number, foreign) in enumerate(
            zip(self.drive.frames, self.drive.foreign, strict=True)
        ):
            frame = (self._other if foreign else self._query)[number]
            stamp_ns = round(index * self._step_ns)
            yield replace(frame, index=index, stamp_ns=stamp_ns, odometry_m=None)


def _held(source: Source) -> list[Frame]:
    if source.live:
        raise SourceError("a camera cannot be driven again; record it and give the recording")
    return [replace(frame, image=_encoded(frame.image)) for frame in source]


def _mean_step_ns(frames: list[Frame]) -> float:
    duration_ns = frames[-1].stamp_ns - frames[0].stamp_ns
    return duration_ns / (len(frames) - 1) if duration_ns > 0 else _NOMINAL_NS


def _encoded(image: bytes | np.ndarray) -> bytes:
    """Encode pixels as PNG, which loses nothing."""
    return image if isinstance(image, bytes) else cv2.imencode(".png", image)[1].tobytes()
