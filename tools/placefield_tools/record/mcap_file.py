"""Recordings as MCAP, which Foxglove opens.

The file is written in chunks of a few dozen matches, or of one image. A file that was cut off lacks
only its last chunk and its index; ``mcap recover`` restores the index.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mcap.writer import Writer

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.maps.geography import Origin
from placefield_tools.record import foxglove
from placefield_tools.record.recorder import Recorder
from placefield_tools.record.records import kind_of

_CHUNK_BYTES = 16 * 1024

_TOPICS = {
    "/placefield/match": foxglove.MATCH,
    "/placefield/pose": foxglove.POSE_IN_FRAME,
    "/placefield/location": foxglove.LOCATION_FIX,
    "/placefield/smoothed/match": foxglove.MATCH,
    "/placefield/smoothed/pose": foxglove.POSE_IN_FRAME,
    "/placefield/smoothed/location": foxglove.LOCATION_FIX,
    "/placefield/verified/match": foxglove.MATCH,
    "/placefield/verified/pose": foxglove.POSE_IN_FRAME,
    "/placefield/verified/location": foxglove.LOCATION_FIX,
    "/placefield/frame": foxglove.COMPRESSED_IMAGE,
    "/placefield/place": foxglove.COMPRESSED_IMAGE,
}


@contextmanager
def record_mcap(path: Path, origin: Origin | None) -> Iterator[Recorder]:
    """Record every match, and for known matches the pose and, with ``origin``, the position.

    The messages have the stamps of their frames.
    """
    with path.open("xb") as file:
        writer = Writer(file, chunk_size=_CHUNK_BYTES)
        writer.start(profile="", library="placefield")
        channels = {topic: _register(writer, topic, schema) for topic, schema in _TOPICS.items()}

        def put(topic: str, header: Header, message: foxglove.Message) -> None:
            time, data = foxglove.log_time(header), json.dumps(message).encode()
            writer.add_message(channels[topic], log_time=time, publish_time=time, data=data)
            file.flush()

        def write_match(header: Header, match: MatchMessage | None) -> None:
            kind = kind_of(match)
            root = "/placefield" if kind == "causal" else f"/placefield/{kind}"
            put(f"{root}/match", header, foxglove.match_message(header, match))
            if match is None or match.pose is None or match.known is False:
                return
            x, y, yaw = match.pose
            put(f"{root}/pose", header, foxglove.pose_message(header, x, y, yaw))
            if origin is not None:
                fix = foxglove.location_message(header, *origin.to_degrees(x, y))
                put(f"{root}/location", header, fix)

        def write_frame(header: Header, jpeg: bytes) -> None:
            put("/placefield/frame", header, foxglove.image_message(header, jpeg))

        def write_place(header: Header, jpeg: bytes) -> None:
            put("/placefield/place", header, foxglove.image_message(header, jpeg))

        try:
            yield Recorder(write_match, write_frame, write_place)
        finally:
            writer.finish()  # type: ignore[no-untyped-call]


def _register(writer: Writer, topic: str, schema: foxglove.Schema) -> int:
    described = writer.register_schema(
        name=schema["title"], encoding="jsonschema", data=json.dumps(schema).encode()
    )
    return writer.register_channel(topic, message_encoding="json", schema_id=described)
