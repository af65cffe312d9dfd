"""Parsing of single messages of an MCAP file, in any encoding."""

import json
from types import SimpleNamespace
from typing import Any

from mcap.records import Channel, Message, Schema

from placefield.errors import SourceError
from placefield_tools.sources.protobuf_messages import parse_message
from placefield_tools.sources.ros_types import full_name, parser_of

_NS = 1_000_000_000


def kind_of(schema: Schema | None) -> str:
    """Return the type of a channel's messages, with the full name for ROS."""
    return full_name(schema.name) if schema else ""


def read_message(schema: Schema | None, channel: Channel, message: Message) -> tuple[int, Any]:
    """Return the stamp of a message, nanoseconds, and its fields.

    A message without a stamp gets the recorder's.

    Raises:
        SourceError: its encoding is not supported.
    """
    fields = _fields(schema, channel, message)
    return stamp_ns_of(fields) or message.log_time, fields


def _fields(schema: Schema | None, channel: Channel, message: Message) -> Any:
    match channel.message_encoding:
        case "json":
            return json.loads(message.data, object_hook=lambda each: SimpleNamespace(**each))
        case "protobuf" if schema is not None:
            return parse_message(schema.name, schema.data, message.data)
        case ("cdr" | "ros1") as encoding if schema is not None:
            parse = parser_of(
                full_name(schema.name),
                schema.data.decode(),
                is_idl=schema.encoding in ("ros2idl", "omgidl"),
                is_ros1=encoding == "ros1",
            )
            return parse(message.data)
        case encoding:
            raise SourceError(
                f"{channel.topic}: the encoding {encoding!r} of its messages is not supported; "
                "record cdr, ros1, json or protobuf"
            )


def stamp_ns_of(fields: Any) -> int:
    """Return the stamp of a message, nanoseconds, in the form of ROS or of Foxglove."""
    header = getattr(fields, "header", None)
    stamp = fields.timestamp if header is None else header.stamp
    if hasattr(stamp, "ToNanoseconds"):
        return int(stamp.ToNanoseconds())
    nanoseconds = stamp.nanosec if hasattr(stamp, "nanosec") else stamp.nsec
    return int(stamp.sec * _NS + nanoseconds)
