"""An MCAP file chunk by chunk: messages of those that are whole, and how many the others held."""

from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.records import Chunk, ChunkIndex, Message, MessageIndex
from mcap.stream_reader import breakup_chunk

from placefield_tools.sources.mcap_messages import read_message
from placefield_tools.sources.mcap_summary import MAX_CHUNK_BYTES, read_summary
from placefield_tools.sources.recorded_images import Read

_RECORD_HEAD = 9  # bytes: what it is, and its length


def messages_by_chunk(path: Path, topic: str) -> Iterator[Read]:
    """Yield what reads a message, for each of a topic; that of a damaged chunk raises ValueError.

    Chunks are in the order of their first messages, as a recorder that writes one after the other
    has them. How many messages a damaged one held is told by its message index, if that is whole.

    Raises:
        SourceError: see ``read_summary``.
    """
    summary = read_summary(path)
    if summary is None:
        return
    channels = {number: each for number, each in summary.channels.items() if each.topic == topic}
    chunks = sorted(
        summary.chunk_indexes,
        key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset),
    )
    with path.open("rb") as file:
        for chunk in chunks:
            try:
                messages = _messages_of(file, chunk, channels)
            except Exception:  # whatever decompression and parsing stumble over
                yield from [_lost] * _count_of(file, chunk, channels)
                continue
            for message in messages:
                channel = channels[message.channel_id]
                yield partial(
                    read_message, summary.schemas.get(channel.schema_id), channel, message
                )


def _messages_of(file: BinaryIO, chunk: ChunkIndex, channels: Collection[int]) -> list[Message]:
    file.seek(chunk.chunk_start_offset + _RECORD_HEAD)
    held = Chunk.read(ReadDataStream(file))
    if held.uncompressed_size > MAX_CHUNK_BYTES:
        raise ValueError("it claims to be larger than its index says")
    records = breakup_chunk(held, validate_crc=True)
    messages = [each for each in records if isinstance(each, Message)]
    messages = [each for each in messages if each.channel_id in channels]
    return sorted(messages, key=lambda message: message.log_time)


def _count_of(file: BinaryIO, chunk: ChunkIndex, channels: Collection[int]) -> int:
    """Return how many messages of these channels a chunk holds, by its index; 0 if it is gone."""
    count = 0
    for number in set(channels) & set(chunk.message_index_offsets):
        file.seek(chunk.message_index_offsets[number] + _RECORD_HEAD)
        try:
            count += len(MessageIndex.read(ReadDataStream(file)).records)
        except Exception:
            return 0
    return count


def _lost() -> tuple[int, Any]:
    raise ValueError("its chunk is damaged")
