"""A source that checks that a file of poses has one line for each frame."""

from collections.abc import Iterator

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.sources.source import Derived, Source


class PoseLineCheck(Derived):
    """The frames of a source, each of which must have a line in a file of poses.

    The number of a video's frames is known only at its end. The file may count its missing frames
    or not.
    """

    def __init__(self, source: Source, poses: str, lines: int, stride: int) -> None:
        """Wrap a source; ``poses`` names the file, ``lines`` is the number of its lines."""
        super().__init__(source)
        self.count = source.count
        self._poses, self._lines, self._stride = poses, lines, stride

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError if a frame has no line, or lines have no frame."""
        index = -1
        for frame in self._source:
            index = frame.index
            if index >= self._lines:
                raise SourceError(
                    f"--poses {self._poses}: has {self._lines} lines, but none for {frame.name}; "
                    "give a line for each frame"
                )
            yield frame
        fewest = index + 1
        most = index + self._stride
        missing = self._source.not_given["missing"]
        if not (fewest <= self._lines <= most or fewest <= self._lines - missing <= most):
            raise SourceError(
                f"--poses {self._poses}: has {self._lines} lines for {fewest} frames: give a line "
                "for each frame, or stamps of the video's clock (TUM)"
            )
