"""One drive in several sources, as a recorder leaves it that begins another file now and then."""

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
"""The longest that a recorder takes from one file to the next, and of files that it numbers."""

_OVERLAP_NS = _SECOND // 10
_STEPS = 3  # usual ones, of frames that are taken seldom


class OneDrive(Source):
    """The frames of parts, one part after the other, and numbered throughout.

    Odometry that counts from the start of each part goes on from the end of the part before. Poses
    in degrees are those of the first part's plane.
    """

    def __init__(self, parts: Sequence[Source], name: str, *, start: int, stride: int) -> None:
        """Take the parts, which give all their frames.

        Args:
            parts: in the order of the drive, one or more.
            name: of the drive, for a person.
            start: the first frame.
            stride: from one frame to the next.
        """
        self._parts = parts
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
                raise SourceError(f"--start {start}: {name} holds {sum(counts)} frames only")

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError where a part fails."""
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
        """Give back what the parts hold."""
        for part in self._parts:
            part.close()


def goes_on(before: Source, after: Source, *, numbered: bool = False) -> bool:
    """Return whether a source begins where another ends, as parts of one drive do.

    Args:
        before: a source.
        after: another one.
        numbered: whether their names are numbered on, which takes a longer pause.
    """
    if before.span is None or after.span is None or after.span.first_ns <= before.span.first_ns:
        return False
    gap_ns = after.span.first_ns - before.span.last_ns
    duration_ns = before.span.last_ns - before.span.first_ns
    longest_ns = _NUMBERED_GAP_NS if numbered else _GAP_NS
    step_ns = duration_ns / (before.count - 1) if before.count and before.count > 1 else 0
    return -_OVERLAP_NS <= gap_ns <= max(longest_ns, _STEPS * step_ns)


def in_order_of_time(name: str, parts: Sequence[Source]) -> list[int]:
    """Return the numbers of parts of one drive in order of time; a long pause is logged.

    Raises:
        SourceError: two were recorded at the same time.
    """
    spans = [part.span or Span(0, 0) for part in parts]
    order = sorted(range(len(parts)), key=lambda number: (spans[number], number))
    for before, after in pairwise(order):
        gap_ns = spans[after].first_ns - spans[before].last_ns
        if gap_ns < -_OVERLAP_NS:
            raise SourceError(
                f"{name}: parts {before + 1} and {after + 1} were recorded at the same time, and "
                "are not one drive; give them one by one"
            )
        if not goes_on(parts[before], parts[after]):
            log.warning(
                "%s: %s pass between parts %d and %d of what is read as one drive",
                name,
                counted(round(gap_ns / _SECOND), "second"),
                before + 1,
                after + 1,
            )
    return order
