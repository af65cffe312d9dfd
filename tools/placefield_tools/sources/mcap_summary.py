"""The summary of an MCAP file, which is read before any message."""

from pathlib import Path

from mcap.reader import make_reader
from mcap.summary import Summary

from placefield.errors import SourceError
from placefield_tools.sources.source import Span

MAX_CHUNK_BYTES = 256 * 2**20
"""The largest chunk that is read: readers decompress a whole chunk at once."""


def read_summary(path: Path) -> Summary | None:
    """Read the summary of an MCAP file; None if it has none.

    The sizes of the chunks are checked as the summary states them. A file without a summary, or
    with a false one, can need any amount of memory to read.

    Raises:
        SourceError: a chunk is larger than ``MAX_CHUNK_BYTES``.
    """
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    chunks = summary.chunk_indexes if summary else []
    largest = max((chunk.uncompressed_size for chunk in chunks), default=0)
    if largest > MAX_CHUNK_BYTES:
        raise SourceError(
            f"{path}: has a chunk of {largest / 2**20:.0f} MiB, and at most "
            f"{MAX_CHUNK_BYTES // 2**20} MiB are allowed; record in smaller chunks"
        )
    return summary


def span_of(summary: Summary) -> Span:
    """Return from when to when an MCAP file was recorded, by its summary with statistics."""
    assert summary.statistics is not None
    return Span(summary.statistics.message_start_time, summary.statistics.message_end_time)
