"""Signs that the names of files are not in the order of the drive."""

import logging
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median

log = logging.getLogger(__name__)

_COPY = re.compile(r"(.+?)(?: ?\([0-9]+\)|( -|_|-)? ?copy(?: ?\(?[0-9]+\)?)?)", re.IGNORECASE)
_COUNTED = re.compile(r"(.*?)([0-9]{3,})", re.DOTALL)
_DIGITS = 4  # of a camera's counter; the digits before may be the number of a group
_NEAR, _FAR = 10, 50  # steps: from the counter's ends, and of the gap between the two parts


def warn_of_copies(folder: Path, files: Sequence[str]) -> None:
    """Log files that are named as copies of others: a copied place would come twice."""
    stems = {Path(file).stem for file in files}
    copies = [file for file in files if _original(file) in stems]
    if copies:
        log.warning(
            "%s: %d of %d files are named like copies of others, for example %r, and follow them; "
            "remove the copies",
            folder,
            len(copies),
            len(files),
            copies[0],
        )


def warn_of_wrap(folder: Path, files: Sequence[str]) -> None:
    """Log that a camera's counter seems to have wrapped in the middle of a drive.

    Args:
        folder: of the files.
        files: names, in natural sort order.
    """
    stems = {Path(file).stem for file in files}
    files = [file for file in files if _original(file) not in stems]
    at = wrap_in(files)
    if at is not None:
        log.warning(
            "%s: the camera's counter seems to begin at %s and to wrap after %s, but %s is used as "
            "the first frame; give the order in a frames.csv, or rename the files",
            folder,
            files[at],
            files[-1],
            files[0],
        )


def wrap_in(files: Sequence[str]) -> int | None:
    """Return the index of the drive's first file, if a counter of fixed width has wrapped.

    That is assumed if the names differ only in the counter, the lowest and the highest numbers are
    both used, and there is one wide gap between. None: the counter has not wrapped.

    Args:
        files: names, in natural sort order.
    """
    counted = [
        (each[1], each[2]) for file in files if (each := _COUNTED.fullmatch(Path(file).stem))
    ]
    shapes = {(prefix, len(number)) for prefix, number in counted}
    if len(files) < 3 or len(counted) < len(files) or len(shapes) != 1:
        return None
    [(_, digits)] = shapes
    if len({number[:-_DIGITS] for _, number in counted}) == 1:
        digits = min(digits, _DIGITS)
    numbers = [int(number[-digits:]) for _, number in counted]
    steps = [after - before for before, after in pairwise(numbers)]
    step = max(median(steps), 1)
    widest = max(steps)
    touches = numbers[0] <= _NEAR * step and 10**digits - 1 - numbers[-1] < _NEAR * step
    rest = sorted(steps)[:-1]
    if touches and widest > _FAR * step and rest[-1] < widest / 2:
        return steps.index(widest) + 1
    return None


def _original(file: str) -> str | None:
    named = _COPY.fullmatch(Path(file).stem)
    return named[1] if named else None
