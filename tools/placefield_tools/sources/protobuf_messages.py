"""Parsing of Protobuf messages by the schema that the recording holds."""

from functools import lru_cache
from typing import Any

from google.protobuf import (  # type: ignore[import-untyped]
    descriptor_database,
    descriptor_pb2,
    descriptor_pool,
    message_factory,
)


def parse_message(schema_name: str, schema: bytes, data: bytes) -> Any:
    """Parse a message.

    Args:
        schema_name: full name of its type.
        schema: the ``FileDescriptorSet`` that holds it.
        data: the message.
    """
    return _message_class(schema_name, schema).FromString(data)


@lru_cache(maxsize=16)
def _message_class(schema_name: str, schema: bytes) -> Any:
    files = descriptor_database.DescriptorDatabase()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
        files.Add(file)
    pool = descriptor_pool.DescriptorPool(files)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema_name))
