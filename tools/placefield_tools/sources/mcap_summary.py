"""What an MCAP file says of itself, before a message of it is read."""

from pathlib import Path

from mcap.reader import make_reader
from mcap.summary import Summary

from placefield.errors import SourceError
from placefield_tools.sources.source import Span

MAX_CHUNK_BYTES = 256 * 2**20
"""Readers decompress a whole chunk at once; recorders write chunks of a few MB."""


def read_summary(path: Path) -> Summary | None:
    """Read the summary of an MCAP file; None where it has none.

    That chunks keep to ``MAX_CHUNK_BYTES`` is the summary's word: a file without one, or with a
    false one, can take any amount of memory to read.

    Raises:
        SourceError: a chunk takes more memory than this.
    """
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    chunks = summary.chunk_indexes if summary else []
    largest = max((chunk.uncompressed_size for chunk in chunks), default=0)
    if largest > MAX_CHUNK_BYTES:
        raise SourceError(
            f"{path}: a chunk of it takes {largest / 2**20:.0f} MiB of memory, more than the "
            f"{MAX_CHUNK_BYTES // 2**20} allowed; record in smaller chunks"
        )
    return summary


def span_of(summary: Summary) -> Span:
    """Return from when to when an MCAP file was recorded, by its summary with statistics."""
    assert summary.statistics is not None
    return Span(summary.statistics.message_start_time, summary.statistics.message_end_time)
