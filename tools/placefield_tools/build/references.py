"""Describing reference traverses frame by frame; bad frames are refused or left out."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.errors import FrameError, SourceError
from placefield.features.extract import Feature
from placefield.features.frames import Frame
from placefield.maps.traverse import (
    ROUTE,
    DescribedFrame,
    Traverse,
    content_of,
    describe_frame,
    traverse_of,
)
from placefield.verification.extractor import Extractor
from placefield_tools.common.parallel import map_in_order
from placefield_tools.common.progress import tracked
from placefield_tools.sources import Source

log = logging.getLogger(__name__)

_REMEDY = "repair it, or give --leave-out-bad to build without"


@dataclass(frozen=True)
class Reference:
    """A reference traverse of K frames.

    Attributes:
        name: used in messages.
        frames: K described frames, None for a bad one.
        pose_frame: name of the poses' coordinate frame.
        stamped: whether the stamps are measured, and not nominal.
        local_network: see ``Traverse``.
    """

    name: str
    frames: Sequence[DescribedFrame | None]
    pose_frame: str = ROUTE
    stamped: bool = True
    local_network: NDArray[np.uint8] | None = None

    @property
    def content(self) -> str:
        """The checksum of its frames, see ``content_of``; bad frames are not in it."""
        return content_of(frame.raw for frame in self.frames if frame is not None)

    def traverse(self) -> Traverse:
        """Return the traverse without its bad frames; see ``traverse_of`` for the errors."""
        good = (frame for frame in self.frames if frame is not None)
        traverse = traverse_of(self.name, good, self.pose_frame, stamped=self.stamped)
        return replace(traverse, local_network=self.local_network)


def describe_reference(
    source: Source,
    name: str,
    feature: Feature,
    *,
    leave_out_bad: bool,
    extractor: Extractor | None = None,
) -> Reference:
    """Describe all frames of a source.

    Args:
        source: of the frames.
        name: of the traverse.
        feature: describes the frames.
        extractor: of the local features of the frames; None: they have none.
        leave_out_bad: continue without frames that are missing or cannot be read.

    Raises:
        SourceError: a frame is missing or cannot be read and ``leave_out_bad`` is false, because a
            missing frame may shift every later place; or no frame can be read.
    """
    faults: dict[int, FrameError] = {}

    def describe(frame: Frame) -> DescribedFrame | None:
        try:
            return describe_frame(frame, feature, extractor)
        except FrameError as error:
            if not leave_out_bad:
                raise SourceError(f"{error}; {_REMEDY} such frames") from None
            faults[frame.index] = error
            return None

    shown = Path(name).name
    with tracked(source, f"describing {shown}", source.count) as frames:
        described = list(map_in_order(describe, frames))
    if faults:
        log.warning(
            "%s: %d of %d frames cannot be read and are left out (the first: %s)",
            name,
            len(faults),
            len(described),
            faults[min(faults)],
        )
    if len(faults) == len(described) > 0:
        raise SourceError(f"{name}: no frame can be read ({faults[min(faults)]})")
    missing = source.not_given["missing"]
    if missing and not leave_out_bad:
        raise SourceError(f"{name}: {missing} frames are missing; {_REMEDY} them")
    pose_frame = source.origin.frame if source.origin else ROUTE
    network = None if extractor is None else extractor.onnx
    return Reference(name, described, pose_frame, source.stamped, network)


def check_distinct(references: Sequence[Reference]) -> None:
    """Refuse a drive that is given twice, whatever its names.

    Raises:
        SourceError: two references have the same frames.
    """
    names: dict[str, str] = {}
    for reference in references:
        content = reference.content
        if content in names:
            raise SourceError(
                f"{reference.name}: is the same drive as {names[content]}: the frames are the "
                "same; give each drive once"
            )
        names[content] = reference.name


def without_bad(references: Sequence[Reference]) -> list[Reference]:
    """Remove bad frames.

    If all traverses have the same number of frames, a frame that is bad in one is removed from all,
    because frame i of each may be one place.
    """
    if len({len(reference.frames) for reference in references}) > 1:
        return [
            replace(reference, frames=[frame for frame in reference.frames if frame is not None])
            for reference in references
        ]
    bad = {
        index
        for reference in references
        for index, frame in enumerate(reference.frames)
        if frame is None
    }
    return [
        replace(
            reference,
            frames=[frame for index, frame in enumerate(reference.frames) if index not in bad],
        )
        for reference in references
    ]
