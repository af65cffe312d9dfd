"""Folders of frames made of others."""

from pathlib import Path
from shutil import copy


def first_frames(folder: Path, count: int, target: Path) -> Path:
    """Copy a folder's first frames into a new one."""
    target.mkdir(parents=True)
    for file in sorted(folder.iterdir())[:count]:
        copy(file, target)
    return target
