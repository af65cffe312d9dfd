"""Progress, on stderr: standard output is for results."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
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


@contextmanager
def tracked(items: Iterable[Item], what: str, total: int | None) -> Iterator[Iterator[Item]]:
    """Give the items, showing how many have gone by; the bar is gone after the block.

    A generator that closed the bar itself would, if abandoned, be closed wherever it is collected:
    in the thread that draws another bar, say, which would then wait for itself.
    """
    with progress_bar() as bar:
        task = bar.add_task(what, total=total)

        def advancing() -> Iterator[Item]:
            for item in items:
                yield item
                bar.advance(task)

        yield advancing()
