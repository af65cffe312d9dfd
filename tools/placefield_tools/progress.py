"""Progress, on stderr: standard output is for results."""

from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

Item = TypeVar("Item")

CONSOLE = Console(stderr=True, markup=False)


def progress_bar() -> Progress:
    """Return a bar with counts, time passed and time left."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=CONSOLE,
    )


def tracked(items: Iterable[Item], what: str, total: int | None) -> Iterator[Item]:
    """Yield the items, showing how many have gone by."""
    with progress_bar() as bar:
        yield from bar.track(items, total=total, description=what)
