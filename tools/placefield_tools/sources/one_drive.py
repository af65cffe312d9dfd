"""One drive in several sources, as a recorder that splits its files writes it."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.common.natural_sort import counted
from placefield_tools.sources.source import Source, Span

log = logging.getLogger(__name__)

_SECOND = 1_000_000_000
_GAP_NS, _NUMBERED_GAP_NS = 5 * _SECOND, 60 * _SECOND
"""The longest pause between two files of one drive; the second is for numbered files."""

_OVERLAP_NS = _SECOND // 10
_STEPS = 3  # mean steps between frames, if frames are rare


class OneDrive(Source):
    """The frames of several parts in sequence, numbered throughout.

    If the odometry restarts in a part, it continues from the end of the part before. Georeferenced
    poses are converted to the tangent plane of the first part.
    """

    def __init__(self, parts: Sequence[Source], name: str, *, start: int, stride: int) -> None:
        """Join the parts, which are opened without start and stride.

        Args:
            parts: one or more, in the order of the drive.
            name: of the drive, used in messages.
            start: index of the first frame.
            stride: step from one frame to the next.

        Raises:
            SourceError: the drive ends before ``start``, or parts have images and others
                descriptors, or these have different dimensions.
        """
        self._parts = parts
        self.dimensions = parts[0].dimensions
        if any(part.dimensions != self.dimensions for part in parts):
            raise SourceError(
                f"{name}: its parts are not alike; give images, or descriptors of one dimension"
            )
        self._start, self._stride = start, stride
        self.origin = next((part.origin for part in parts if part.origin is not None), None)
        spans = [part.span for part in parts]
        if spans[0] is not None and spans[-1] is not None:
            self.span = Span(spans[0].first_ns, spans[-1].last_ns)
        counts = [part.count for part in parts if part.count is not None]
        self.count = None
        if len(counts) == len(parts):
            self.count = len(range(start, sum(counts), stride))
            if not self.count:
                raise SourceError(f"--start {start}: {name} holds only {sum(counts)} frames")

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError if a part fails."""
        first = 0
        offset_m, last_m = 0.0, 0.0
        for part in self._parts:
            index = first - 1
            is_first = True
            for frame in part:
                index = first + frame.index
                reading = frame.odometry_m
                if reading is not None:
                    if is_first and offset_m + reading < last_m:
                        offset_m = last_m - reading
                    is_first = False
                    last_m = offset_m + reading
                    reading = last_m
                if index >= self._start and (index - self._start) % self._stride == 0:
                    yield replace(self._on_plane(frame, part), index=index, odometry_m=reading)
            first = index + 1
        self.not_given.clear()
        for part in self._parts:
            self.not_given.update(part.not_given)

    def _on_plane(self, frame: Frame, part: Source) -> Frame:
        if frame.pose is None or part.origin is None or self.origin in (None, part.origin):
            return frame
        assert self.origin is not None
        x, y = self.origin.to_local(*part.origin.to_degrees(frame.pose.x, frame.pose.y))
        return replace(frame, pose=frame.pose._replace(x=x, y=y))

    def close(self) -> None:
        """Close the parts."""
        for part in self._parts:
            part.close()


def goes_on(before: Source, after: Source, *, numbered: bool = False) -> bool:
    """Return whether a source begins where another ends, as parts of one drive do.

    Args:
        before: the earlier source.
        after: the later source.
        numbered: whether their names are consecutive, which allows a longer pause.
    """
    if before.span is None or after.span is None or after.span.first_ns <= before.span.first_ns:
        return False
    gap_ns = after.span.first_ns - before.span.last_ns
    duration_ns = before.span.last_ns - before.span.first_ns
    longest_ns = _NUMBERED_GAP_NS if numbered else _GAP_NS
    step_ns = duration_ns / (before.count - 1) if before.count and before.count > 1 else 0
    return -_OVERLAP_NS <= gap_ns <= max(longest_ns, _STEPS * step_ns)


def in_order_of_time(name: str, parts: Sequence[Source]) -> list[int]:
    """Return the numbers of the parts of one drive in order of time; long pauses are logged.

    Raises:
        SourceError: two parts were recorded at the same time.
    """
    spans = [part.span or Span(0, 0) for part in parts]
    order = sorted(range(len(parts)), key=lambda number: (spans[number], number))
    for before, after in pairwise(order):
        gap_ns = spans[after].first_ns - spans[before].last_ns
        if gap_ns < -_OVERLAP_NS:
            raise SourceError(
                f"{name}: parts {before + 1} and {after + 1} were recorded at the same time, so "
                "they are not one drive; give them one by one"
            )
        if not goes_on(parts[before], parts[after]):
            log.warning(
                "%s: there are %s between parts %d and %d of what is read as one drive",
                name,
                counted(round(gap_ns / _SECOND), "second"),
                before + 1,
                after + 1,
            )
    return order
