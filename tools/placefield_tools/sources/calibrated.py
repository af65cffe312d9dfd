"""A source of frames of a calibrated camera."""

from collections.abc import Iterator
from dataclasses import replace

from placefield.features.calibration import Calibration
from placefield.features.frames import Frame
from placefield_tools.sources.source import Derived, Source


class Calibrated(Derived):
    """The frames of a source, each with the calibration of the camera that took it."""

    def __init__(self, source: Source, calibration: Calibration) -> None:
        super().__init__(source)
        self.count = source.count
        self.calibration = calibration

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError if the source fails."""
        return (replace(frame, calibration=self.calibration) for frame in self._source)
