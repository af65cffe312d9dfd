"""Formats the docstrings of commands for terminals of any width."""

import inspect
from collections.abc import Callable
from typing import Any

_EXAMPLES = "Examples:"


def unwrapped(command: Callable[..., Any] | None) -> str:
    """Return a command's docstring with a line per paragraph; examples keep a line each."""
    paragraphs = (inspect.getdoc(command) or "").split("\n\n")
    return "\n\n".join(
        paragraph if paragraph.startswith(_EXAMPLES) else " ".join(paragraph.split("\n"))
        for paragraph in paragraphs
    )
