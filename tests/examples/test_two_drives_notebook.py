"""The notebook runs from a clean folder, and shows what its text says."""

import re
from itertools import chain
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).resolve().parents[2] / "examples" / "two_drives.ipynb"


@pytest.fixture(scope="module")
def committed() -> Any:
    return nbformat.read(NOTEBOOK, as_version=4)


def test_no_outputs_are_committed(committed: Any) -> None:
    nbformat.validate(committed)
    code = [cell for cell in committed.cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)


@pytest.mark.slow
def test_every_cell_runs_and_shows_pictures_and_a_good_result(
    committed: Any, tmp_path: Path
) -> None:
    resources = {"metadata": {"path": tmp_path}}
    ran = NotebookClient(committed.copy(), timeout=240, resources=resources).execute()
    assert list(tmp_path.iterdir()) == []  # what it writes is in a folder of its own
    outputs = list(chain.from_iterable(cell.get("outputs", ()) for cell in ran.cells))
    pictures = [one for one in outputs if "image/png" in one.get("data", {})]
    assert len(pictures) == 4
    printed = "".join(one.text for one in outputs if one.output_type == "stream")
    right, frames = re.findall(r"\d+", printed)[:2]
    assert int(right) >= 0.9 * int(frames) > 50
    assert " 0 of these wrong" in printed.replace("\n", " ")
