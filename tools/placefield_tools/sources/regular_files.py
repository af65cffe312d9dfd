"""Checks of files in an untrusted folder."""

import os
from pathlib import Path, PurePosixPath

from placefield.errors import SourceError


def check_file(path: Path) -> None:
    """Refuse a path that is no regular file: opening a pipe would block for ever.

    Raises:
        SourceError: it is no regular file, or a broken link.
    """
    if path.is_file():
        return
    if os.path.islink(path) and not path.exists():
        raise SourceError(f"{path}: a link to nothing; put the file there, or remove the link")
    raise SourceError(f"{path}: no regular file; remove it, or put the file there")


def check_inside(name: str) -> None:
    """Refuse the name of a file that leads out of its folder.

    Raises:
        ValueError: the name is absolute or contains ``..``.
    """
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        raise ValueError(f"the file {name!r} is not in the folder; put it there")
