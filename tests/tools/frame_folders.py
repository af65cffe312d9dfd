"""Folders of frames made of others."""

from pathlib import Path
from shutil import copy, copytree

import numpy as np


def first_frames(folder: Path, count: int, target: Path) -> Path:
    """Copy a folder's first frames into a new one."""
    target.mkdir(parents=True)
    for file in sorted(folder.iterdir())[:count]:
        copy(file, target)
    return target


def uneven_drive(folder: Path, target: Path) -> Path:
    """Copy a folder whose frames are 0.1 m apart, as a drive that slows down and stops takes it."""
    copytree(folder, target)
    files = sorted(file.name for file in target.iterdir())
    taken = np.repeat(np.arange(len(files)), np.random.default_rng(3).integers(1, 6, len(files)))
    rows = [f"{files[number]},{number / 10:g}" for number in taken]
    (target / "frames.csv").write_text("\n".join(["file,odometry", *rows]))
    return target
