"""A source of as many frames as a file has lines."""

from collections.abc import Iterator

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield_tools.sources.source import Derived, Source


class PoseLineCheck(Derived):
    """The frames of a source of which each has its line in a file of poses.

    How many a video has is known only at its end: those that it lacks have lines too, or none has.
    """

    def __init__(self, source: Source, poses: str, lines: int, stride: int) -> None:
        """Take the source, the file's name, how many lines it has, and the source's stride."""
        super().__init__(source)
        self.count = source.count
        self._poses, self._lines, self._stride = poses, lines, stride

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError where one has no line, or lines have no frame."""
        index = -1
        for frame in self._source:
            index = frame.index
            if index >= self._lines:
                raise SourceError(
                    f"--poses {self._poses}: has {self._lines} lines, and none for {frame.name}"
                )
            yield frame
        fewest = index + 1
        most = index + self._stride
        missing = self._source.not_given["missing"]
        if not (fewest <= self._lines <= most or fewest <= self._lines - missing <= most):
            raise SourceError(
                f"--poses {self._poses}: has {self._lines} lines, and there are {fewest} frames: "
                "give a line for each frame, or a stamp of the video's clock (TUM)"
            )
