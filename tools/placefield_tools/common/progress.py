"""Progress, on stderr: standard output is for results."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from threading import Event
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from placefield.maps.build_steps import Progress as BuildProgress

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
    """Yield the items with a progress bar, which is removed at the end of the block.

    A context manager closes the bar in a known thread. A bare generator, if abandoned, might be
    closed in the thread that draws another bar, which would then deadlock.
    """
    with progress_bar() as bar:
        task = bar.add_task(what, total=total)

        def advancing() -> Iterator[Item]:
            for item in items:
                yield item
                bar.advance(task)

        yield advancing()


@contextmanager
def channel_progress(channels: int) -> Iterator[BuildProgress]:
    """Show the number of learned channels, and the progress of the steps under way.

    A report after the block raises an error, which ends a thread whose result is not needed.
    """
    is_over = Event()
    learned: set[int | None] = set()
    at_work: dict[int | None, TaskID] = {}
    with progress_bar() as bar:
        overall = bar.add_task("learning channels", total=channels)

        def report(number: int | None, what: str, share: float) -> None:
            if is_over.is_set():
                raise RuntimeError("the result of this channel is not needed any more")
            if share >= 1:
                if number in at_work:
                    bar.remove_task(at_work.pop(number))
                if what == "learning":
                    learned.add(number)
                    bar.update(overall, completed=len(learned))
            else:
                if number not in at_work:
                    shown = f"  {what}" if number is None else f"  channel {number}: {what}"
                    at_work[number] = bar.add_task(shown, total=100)
                bar.update(at_work[number], completed=round(100 * share))

        try:
            yield report
        finally:
            is_over.set()
