"""Files and folders that a command writes: refused before its work, which may be long."""

import os
from pathlib import Path

from placefield.errors import ConfigError


def check_folder_of(file: Path) -> None:
    """Refuse a file to write whose folder is missing, or cannot be written to.

    Raises:
        ConfigError: it is so.
    """
    folder = file.parent
    if not folder.is_dir():
        raise ConfigError(f"{file}: there is no folder {folder}; make it, or choose another")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ConfigError(f"{file}: the folder {folder} cannot be written to; choose another")


def check_folder(folder: Path) -> None:
    """Refuse a folder for files to write that cannot be made, and make nothing yet.

    Raises:
        ConfigError: it is so.
    """
    existing = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not existing.is_dir():
        raise ConfigError(
            f"{folder}: the folder cannot be made ({existing} is no folder); choose another"
        )
    check_folder_of(existing / "file")


def make_folder(folder: Path) -> None:
    """Make a folder for files to write, if it is missing, and those that it is in.

    Raises:
        ConfigError: it cannot be made, or cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f"{folder}: the folder cannot be made ({error.strerror}); choose another"
        ) from None
    check_folder_of(folder / "file")
