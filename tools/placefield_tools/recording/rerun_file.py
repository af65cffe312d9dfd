"""Recordings as Rerun writes them. What was cut off is readable but for the last moments."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr

from placefield.bus.messages import Header, MatchMessage, SmoothedMessage
from placefield.maps.geography import Origin
from placefield_tools.recording.recorder import Recorder


@contextmanager
def record_rerun(path: Path, origin: Origin | None) -> Iterator[Recorder]:
    """Write every match as numbers over time, and where its place is unless it is unknown.

    There is a timeline of stamps and one of the frames' numbers, besides that of when it came.
    """
    stream = rr.RecordingStream("placefield")
    stream.save(path)

    def set_time(header: Header) -> None:
        stream.set_time("stamp", timestamp=np.datetime64(header.stamp_ns, "ns"))
        stream.set_time("frame", sequence=header.sequence)

    def write_match(header: Header, match: MatchMessage | None) -> None:
        set_time(header)
        if match is None:
            end = f"end of stream {header.stream}: {header.sequence} frames"
            stream.log("stream", rr.TextLog(end))
            return
        is_smoothed = isinstance(match, SmoothedMessage)
        root = "smoothed/" if is_smoothed else ""
        numbers = ("place", "score", "probability", "known", "too_fast")
        for name in (*numbers, *(["lag"] if is_smoothed else [])):
            value = getattr(match, name)
            if value is not None:
                stream.log(f"{root}match/{name}", rr.Scalars(float(value)))
        if match.pose is None or match.known is False:
            return
        x, y, _ = match.pose
        stream.log(f"{root}route/position", rr.Points3D([[x, y, 0.0]]))
        if origin is not None:
            stream.log(f"{root}earth/position", rr.GeoPoints(lat_lon=[origin.to_degrees(x, y)]))

    def write_frame(header: Header, jpeg: bytes) -> None:
        set_time(header)
        stream.log("frame", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))

    try:
        yield Recorder(write_match, write_frame)
    finally:
        stream.disconnect()
