"""A source whose frames are sampled at equal distances, by odometry."""

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
    """The frames of a source that a ``DistanceSampler`` selects.

    Frames before the first pose of a trajectory are left out, because their distances are unknown.
    That is logged.
    """

    count = None

    def __init__(self, source: Source, metres: float) -> None:
        super().__init__(source)
        self._metres = metres

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames; raise SourceError at a frame without odometry.

        In a live source, a frame without odometry is left out: the vehicle has not reported a move.
        """
        sampler = DistanceSampler(self._metres)
        left_out, begun = 0, not isinstance(self._source, WithPoses)
        for frame in self._source:
            if frame.odometry_m is None:
                if self.live:
                    continue
                if not begun:
                    left_out += 1
                    continue
                raise SourceError(
                    f"{frame.name}: has no odometry to sample by distance; "
                    f"leave --spacing out, or {self._remedy()}"
                )
            begun = True
            if left_out:
                log.warning("%d frames before the first pose: left out by --spacing", left_out)
                left_out = 0
            if sampler.is_due(frame.odometry_m):
                yield frame

    def _remedy(self) -> str:
        if isinstance(self._source, WithPoses):
            return f"give poses that are at most {MAX_GAP_NS / 1e9:g} s apart there"
        return "give a frames.csv with the column odometry, --odometry-topic or --poses"
