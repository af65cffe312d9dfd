"""Recordings as text. Each line is flushed to the operating system at once."""

import csv
import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield_tools.record.recorder import Recorder
from placefield_tools.record.records import COLUMNS, as_object, as_row

_LINE_BY_LINE = 1


@contextmanager
def record_json_lines(path: Path) -> Iterator[Recorder]:
    """Record matches as the objects that ``placefield listen --json`` prints."""
    with path.open("x", buffering=_LINE_BY_LINE, encoding="utf-8") as file:

        def write(header: Header, match: MatchMessage | None) -> None:
            file.write(json.dumps(as_object(header, match)) + "\n")

        yield Recorder(write)


@contextmanager
def record_csv(path: Path) -> Iterator[Recorder]:
    """Record a row for each match, below a header of the columns' names."""
    with path.open("x", buffering=_LINE_BY_LINE, encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()

        def write(header: Header, match: MatchMessage | None) -> None:
            if match is not None:
                writer.writerow(as_row(header, match))

        yield Recorder(write)
