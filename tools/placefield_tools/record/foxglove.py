"""The JSON messages of an MCAP recording, and their schemas, for Foxglove.

The schemas ``foxglove.*`` follow https://docs.foxglove.dev/docs/sdk/schemas. Foxglove shows only
fields of one type, so a value that a match does not have is left out.
"""

import base64
import math
from typing import Any

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield_tools.record.records import as_object

FRAME_ID = "map"
"""The coordinate frame of all poses and positions; a recording is of one map."""

Message = dict[str, Any]
Schema = dict[str, Any]

_NUMBER: Schema = {"type": "number"}
_STRING: Schema = {"type": "string"}
_BOOLEAN: Schema = {"type": "boolean"}
_POSITION_COVARIANCE = 9  # of 3 by 3


def _object(title: str, properties: dict[str, Schema]) -> Schema:
    return {"title": title, "type": "object", "properties": properties}


def _numbers(count: int | None = None) -> Schema:
    size = {} if count is None else {"minItems": count, "maxItems": count}
    return {"type": "array", "items": _NUMBER, **size}


_TIME = _object(
    "time",
    {
        "sec": {"type": "integer", "minimum": 0},
        "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999},
    },
)
_STAMPED = {"timestamp": _TIME, "frame_id": _STRING}
_VECTOR = _object("foxglove.Vector3", dict.fromkeys("xyz", _NUMBER))
_QUATERNION = _object("foxglove.Quaternion", dict.fromkeys("xyzw", _NUMBER))
_POSE = _object("foxglove.Pose", {"position": _VECTOR, "orientation": _QUATERNION})

MATCH = _object(
    "placefield.Match",
    {
        "stream": _STRING,
        "sequence": _NUMBER,
        "stamp_ns": _NUMBER,
        "end": _BOOLEAN,
        "map": _STRING,
        "smoothed": _BOOLEAN,
        "verified": _BOOLEAN,
        "place": _NUMBER,
        "score": _NUMBER,
        "missing": _numbers(),
        "probability": _NUMBER,
        "known": _BOOLEAN,
        "too_fast": _BOOLEAN,
        "forgotten": _BOOLEAN,
        "pose": _numbers(3),
        "lag": _NUMBER,
        "inliers": _NUMBER,
        "ratio": _NUMBER,
        "reason": _STRING,
    },
)
POSE_IN_FRAME = _object("foxglove.PoseInFrame", {**_STAMPED, "pose": _POSE})
LOCATION_FIX = _object(
    "foxglove.LocationFix",
    {
        **_STAMPED,
        **dict.fromkeys(("latitude", "longitude", "altitude"), _NUMBER),
        "position_covariance": _numbers(_POSITION_COVARIANCE),
        "position_covariance_type": {
            "title": "foxglove.PositionCovarianceType",
            "oneOf": [{"title": "UNKNOWN", "const": 0}],
        },
    },
)
COMPRESSED_IMAGE = _object(
    "foxglove.CompressedImage",
    {**_STAMPED, "data": {**_STRING, "contentEncoding": "base64"}, "format": _STRING},
)


def match_message(header: Header, match: MatchMessage | None) -> Message:
    """Return the message of a match, or of the end of a stream."""
    return {name: value for name, value in as_object(header, match).items() if value is not None}


def pose_message(header: Header, x: float, y: float, yaw: float) -> Message:
    """Return a pose in the plane: metres, radians counterclockwise from x."""
    return {
        **_stamped(header),
        "pose": {
            "position": {"x": x, "y": y, "z": 0.0},
            "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)},
        },
    }


def location_message(header: Header, latitude: float, longitude: float) -> Message:
    """Return a geographic position, degrees."""
    return {
        **_stamped(header),
        "latitude": latitude,
        "longitude": longitude,
        "altitude": 0.0,
        "position_covariance": [0.0] * _POSITION_COVARIANCE,
        "position_covariance_type": 0,
    }


def image_message(header: Header, jpeg: bytes) -> Message:
    """Return an image."""
    return {**_stamped(header), "data": base64.b64encode(jpeg).decode(), "format": "jpeg"}


def log_time(header: Header) -> int:
    """Return the stamp, nanoseconds; times before the epoch become 0, the format's lowest."""
    return max(0, header.stamp_ns)


def _stamped(header: Header) -> Message:
    seconds, nanoseconds = divmod(log_time(header), 10**9)
    return {"timestamp": {"sec": seconds, "nsec": nanoseconds}, "frame_id": FRAME_ID}
