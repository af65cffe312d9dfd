"""Where the pages are, and how their tables are read."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def page() -> Callable[[str], str]:
    """Return a page of the documentation, by its name."""
    docs = Path(__file__).resolve().parents[2] / "docs"
    return lambda name: (docs / f"{name}.md").read_text()


@pytest.fixture(scope="session")
def rows() -> Callable[[str], list[list[str]]]:
    """Return the cells of all rows of all tables of a text that begin with what is written `so`."""

    def read(text: str) -> list[list[str]]:
        lines = re.findall(r"^\| (`.*) \|$", text, re.MULTILINE)
        return [line.split(" | ") for line in lines]

    return read
