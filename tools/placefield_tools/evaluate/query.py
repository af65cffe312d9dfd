"""A query: the source of its frames, and the protocol of its drive."""

from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from placefield.config import MatchingConfig
from placefield.evaluation.protocols import DEFAULT_EVERY, Protocol, Resampling
from placefield_tools.sources import NO_PARTS, Parts, Source, open_source
from placefield_tools.sources.resampled import ResampledTraverse


@dataclass(frozen=True)
class Query:
    """The source of a query, and the protocol of its drive.

    Attributes:
        where: source of the frames.
        spacing_m: metres between the frames, by odometry; None: every frame.
        protocol: order of the frames in the drive.
        other: source of another route, for the protocol ``off-route`` only.
        seed: of the protocol.
        parts: selects topics and frames of both sources, and says the camera of the reference.
        every: n of a protocol with every n-th frame; None: its default.
        camera: the file of the query's camera; None: it is the reference's.
    """

    where: str
    spacing_m: float | None = None
    protocol: Protocol = "aligned"
    other: str | None = None
    seed: int = 0
    parts: Parts = NO_PARTS
    every: int | None = None
    camera: Path | None = None

    @property
    def other_cameras(self) -> tuple[Path, ...]:
        """The files of the cameras besides the reference's."""
        return () if self.camera is None else (self.camera,)

    def open(self) -> Source:
        """Open the frames, in the order of the drive.

        Raises:
            SourceError: a source cannot be read, or is live and the protocol reorders frames.
        """
        parts = replace(self.parts, camera=self.camera or self.parts.camera)
        opened = partial(open_source, spacing_m=self.spacing_m, parts=parts)
        if self.protocol == "aligned":
            return opened(self.where)
        with ExitStack() as stack:
            query = stack.enter_context(opened(self.where))
            other = stack.enter_context(opened(self.other)) if self.other else None
            every = DEFAULT_EVERY if self.every is None else self.every
            return ResampledTraverse(query, self.protocol, other=other, seed=self.seed, every=every)

    def numbered(self, drive: Resampling) -> Resampling:
        """Return the drive with the frame numbers of the query's source.

        Distance-sampled frames are numbered in their own order.
        """
        if self.spacing_m is not None:
            return drive
        return replace(drive, frames=self.parts.start + self.parts.stride * drive.frames)

    def frames_in_source(self, selected: int) -> int:
        """Return the number of frames of the source, of which ``selected`` are used."""
        start, stride = self.parts.start, self.parts.stride
        whole = replace(self.parts, start=0, stop=None, stride=1)
        if self.spacing_m is not None or whole == self.parts:
            return selected
        with open_source(self.where, parts=whole) as source:
            last = start + stride * (selected - 1)
            return max(source.count or 0, last + 1)

    def matching(self, config: MatchingConfig) -> MatchingConfig:
        """Return the matching settings; the protocol ``reverse`` inverts the direction."""
        turned = config.reverse != (self.protocol == "reverse")
        return config.model_copy(update={"reverse": turned})
