"""What all tests share."""

import os
from pathlib import Path

import pytest

_DATA = Path(
    os.environ.get("PLACEFIELD_DATA")
    or Path(__file__).resolve().parents[2] / "shared" / "data"
)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real frames, which are not part of the project."""
    if not _DATA.is_dir():
        pytest.skip(f"no real frames at {_DATA}; say where they are with PLACEFIELD_DATA")
    return _DATA
