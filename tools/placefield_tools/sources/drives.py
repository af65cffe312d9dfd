"""Grouping of sources that are parts of one drive."""

import logging
import re
from collections.abc import Sequence
from pathlib import Path

from placefield.errors import SourceError
from placefield_tools.sources.one_drive import goes_on
from placefield_tools.sources.recording_files import holds_recordings
from placefield_tools.sources.secrets import without_secrets
from placefield_tools.sources.source import Source
from placefield_tools.sources.source_factory import (
    Parts,
    is_descriptor_source,
    name_of,
    open_source,
)

_NUMBERED = re.compile(r"(.*?)([0-9]{1,9})(\.[A-Za-z][A-Za-z0-9]*)?")

log = logging.getLogger(__name__)

Drive = tuple[str, ...]
"""The sources of one drive, in the order of time."""


def drives_of(references: Sequence[str], parts: Parts, one_drive: bool | None) -> list[Drive]:
    """Group sources by drive: a source that begins where another ends continues its drive.

    Groups of several sources are logged. The drive of the first source comes first.

    Args:
        references: the sources.
        parts: the selected topics and frames of recordings.
        one_drive: True if all sources are parts of one drive, False if each is a drive; None
            decides by their stamps.

    Raises:
        SourceError: a source exists and cannot be read.
    """
    if one_drive is False or len(references) == 1:
        return [(reference,) for reference in references]
    if one_drive:
        return [tuple(references)]
    opened = [_opened(reference, parts) for reference in references]
    numbers = sorted(range(len(opened)), key=lambda number: _start(opened[number]))
    drives: list[list[int]] = []
    for number in numbers:
        before = next(
            (drive for drive in drives if _goes_on(drive[-1], number, references, opened)), None
        )
        if before is None:
            drives.append([number])
        else:
            before.append(number)
    drives.sort(key=min)
    for drive in drives:
        if len(drive) > 1:
            log.warning(
                "%s: continue each other, and are treated as one drive "
                "(--traverses: treat each as a traverse of the route)",
                ", ".join(Path(references[number]).name for number in drive),
            )
    return [tuple(references[number] for number in drive) for drive in drives]


def check_given_once(drives: Sequence[Drive]) -> None:
    """Refuse a drive that is given twice, also by another path to the same file or folder.

    Raises:
        SourceError: two drives have the same sources.
    """
    seen: dict[tuple[Path, ...], Drive] = {}
    for drive in drives:
        place = tuple(Path(source).resolve() for source in drive)
        if place in seen:
            one, other = (without_secrets(name_of(each)) for each in (drive, seen[place]))
            raise SourceError(f"{one}: is the same drive as {other}; give each drive once")
        seen[place] = drive


def _goes_on(
    before: int, after: int, references: Sequence[str], opened: Sequence[Source | None]
) -> bool:
    first, second = opened[before], opened[after]
    if first is None or second is None:
        return False
    return goes_on(first, second, numbered=numbered_on(references[before], references[after]))


def numbered_on(before: str, after: str) -> bool:
    """Return whether two names are consecutive in a series, as drive_0.bag and drive_1.bag."""
    one, other = (_NUMBERED.fullmatch(Path(name).name) for name in (before, after))
    if one is None or other is None:
        return False
    return one[1] == other[1] and one[3] == other[3] and int(other[2]) == int(one[2]) + 1


def _start(source: Source | None) -> int:
    return source.span.first_ns if source is not None and source.span is not None else 0


def _opened(reference: str, parts: Parts) -> Source | None:
    """Open a source that knows when it was recorded; None for a video or a camera."""
    path = Path(reference)
    if holds_recordings(path):
        return open_source(reference, parts=Parts(parts.topic, "none"))
    return open_source(reference) if path.is_dir() or is_descriptor_source(path) else None
