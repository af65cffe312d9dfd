"""Reading a damaged MCAP file chunk by chunk."""

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

_RECORD_HEAD = 9  # bytes: opcode and length


def messages_by_chunk(path: Path, topic: str) -> Iterator[Read]:
    """Yield a reader of each message of a topic; in a damaged chunk, the reader raises ValueError.

    Chunks are in the order of their first messages. The number of messages of a damaged chunk is
    known from its message index, if that is intact.

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
            except Exception:  # decompression and parsing raise errors of any kind
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
    """Return how many messages of these channels a chunk holds, by its index; 0 without one."""
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
