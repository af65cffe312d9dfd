"""Queries of evaluations."""

from pathlib import Path
from shutil import copytree

import pytest


@pytest.fixture
def damaged_query(query_dir: Path, tmp_path: Path) -> Path:
    """The query with one frame cut off and one that is no image."""
    damaged = copytree(query_dir, tmp_path / "damaged")
    cut = damaged / "0020.jpg"
    cut.write_bytes(cut.read_bytes()[:-300])
    (damaged / "0021.jpg").write_bytes(b"")
    return damaged
