"""Files of a folder that somebody else may have filled."""

import os
from pathlib import Path, PurePosixPath

from placefield.errors import SourceError


def check_file(path: Path) -> None:
    """Refuse what is no regular file, or a link to none: opening a pipe would wait for ever.

    Raises:
        SourceError: it is none.
    """
    if path.is_file():
        return
    if os.path.islink(path) and not path.exists():
        raise SourceError(f"{path}: a link to nothing; put the file there, or remove the link")
    raise SourceError(f"{path}: no regular file; remove it, or put the file there")


def check_inside(name: str) -> None:
    """Refuse a name of a file that leads out of the folder which the name is for.

    Raises:
        ValueError: it does.
    """
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        raise ValueError(f"the file {name!r} is not in the folder; put it there")
