"""A source's frames at equal distances along the way, by odometry."""

import logging
from collections.abc import Iterator

from placefield.errors import SourceError
from placefield.features.distance_sampler import DistanceSampler
from placefield.features.frames import Frame
from placefield.maps.trajectory import MAX_GAP_NS
from placefield_tools.sources.source import Derived, Source
from placefield_tools.sources.with_poses import WithPoses

log = logging.getLogger(__name__)


class DistanceSampled(Derived):
    """The frames of a source that a ``DistanceSampler`` takes.

    Frames before the first pose of a trajectory are left out, which is logged: nobody knows how far
    apart they are.
    """

    count = None

    def __init__(self, source: Source, metres: float) -> None:
        super().__init__(source)
        self._metres = metres

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError at one that has no odometry.

        Of a live source it is left out: with no news, the vehicle is no farther for all we know.
        """
        spacing = DistanceSampler(self._metres)
        early, begun = 0, not isinstance(self._source, WithPoses)
        for frame in self._source:
            if frame.odometry_m is None:
                if self.live:
                    continue
                if not begun:
                    early += 1
                    continue
                raise SourceError(
                    f"{frame.name}: has no odometry to space frames by; "
                    f"leave --spacing out, or {self._remedy()}"
                )
            begun = True
            if early:
                log.warning("%d frames before the first pose: left out of the spaced ones", early)
                early = 0
            if spacing.is_due(frame.odometry_m):
                yield frame

    def _remedy(self) -> str:
        if isinstance(self._source, WithPoses):
            return f"give poses that are at most {MAX_GAP_NS / 1e9:g} s apart there"
        return "give a frames.csv with the column odometry, --odometry-topic or --poses"
