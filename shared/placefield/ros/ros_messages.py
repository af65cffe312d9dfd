"""Reads and writes ROS 2 messages as bytes: CDR, by means of rosbags."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError, MessageError
from placefield.features.calibration import Calibration
from placefield.ros.camera_info import CAMERA_INFO, calibration_of_message
from placefield.ros.image_messages import decode_image

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
IMAGE = "sensor_msgs/msg/Image"
IMAGES = (COMPRESSED_IMAGE, IMAGE)
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

OK, WARN, STALE = 0, 1, 3
"""Levels of a status."""

_NS = 10**9


@dataclass(frozen=True)
class Status:
    """A status of ROS: a ``diagnostic_msgs/DiagnosticStatus``.

    Attributes:
        level: ``OK``, ``WARN`` or ``STALE``.
        name: of the component.
        message: a short description.
        hardware: identity of the component's device.
        values: more values by name.
    """

    level: int
    name: str
    message: str
    hardware: str
    values: Mapping[str, str]


@cache
def _typestore() -> "Typestore":
    try:
        from rosbags.typesys import Stores, get_typestore
    except ModuleNotFoundError:
        raise ConfigError("ROS 2 needs rosbags: pip install 'placefield[ros]'") from None
    return get_typestore(Stores.ROS2_JAZZY)


def type_hash(kind: str) -> str:
    """Return the type hash of a kind of messages, as ``RIHS01_...`` (REP 2016).

    Raises:
        ConfigError: rosbags is missing.
    """
    return _typestore().hash_rihs01(kind)


def read_image(kind: str, data: bytes) -> tuple[int, bytes | NDArray[np.uint8]]:
    """Read an image message.

    Args:
        kind: ``COMPRESSED_IMAGE`` or ``IMAGE``.
        data: the message.

    Returns:
        The stamp, nanoseconds, and the image: encoded, or pixels, (H, W) grey or (H, W, 3) BGR.

    Raises:
        MessageError: the message is no image, or its encoding is not supported.
    """
    if kind not in IMAGES:
        raise MessageError(f"{kind:.80}: give a topic of {' or '.join(IMAGES)}")
    message = _decode(kind, data)
    try:
        return stamp_of(message), image_of(kind, message)
    except FrameError as error:
        raise MessageError(f"{kind}: {error}") from None


def stamp_of(message: Any) -> int:
    """Return the stamp of a message that rosbags has read, in nanoseconds."""
    stamp = message.header.stamp
    return int(stamp.sec * _NS + stamp.nanosec)


def image_of(kind: str, message: Any) -> bytes | NDArray[np.uint8]:
    """Return the image of a message.

    Args:
        kind: one of ``IMAGES``.
        message: as rosbags has read it, of ROS 1 or 2.

    Returns:
        The encoded image, or its pixels, (H, W) grey or (H, W, 3) BGR.

    Raises:
        FrameError: the encoding is not supported, or the fields do not fit each other.
    """
    if kind == COMPRESSED_IMAGE:
        encoded: bytes = message.data.tobytes()
        return encoded
    return decode_image(
        message.height,
        message.width,
        message.encoding,
        bool(message.is_bigendian),
        message.step,
        message.data,
    )


def read_position(kind: str, data: bytes) -> NDArray[np.float64]:
    """Read the vehicle's position from an odometry message: (3,), metres.

    Raises:
        MessageError: the message is no ``ODOMETRY``, or the position is not finite.
    """
    if kind != ODOMETRY:
        raise MessageError(f"{kind:.80}: give a topic of {ODOMETRY}")
    at = _decode(kind, data).pose.pose.position
    position = np.array([at.x, at.y, at.z])
    if not np.isfinite(position).all():
        raise MessageError(f"{kind}: the position is not finite")
    return position


def read_calibration(kind: str, data: bytes) -> Calibration:
    """Read the calibration of a camera.

    Raises:
        MessageError: the message is no ``CAMERA_INFO``, or says no calibration.
    """
    if kind != CAMERA_INFO:
        raise MessageError(f"{kind:.80}: give a topic of {CAMERA_INFO}")
    message = _decode(kind, data)
    try:
        return calibration_of_message(message)
    except ValueError as error:
        raise MessageError(f"{kind}: {error}") from None


def _decode(kind: str, data: bytes) -> Any:
    try:
        return _typestore().deserialize_cdr(data, kind)
    except Exception as error:  # rosbags raises many types, AssertionError among them
        raise MessageError(f"{kind}: not CDR: {error!s:.200}") from None


def pose_message(
    stamp_ns: int,
    frame_id: str,
    pose: tuple[float, float, float],
    covariance: NDArray[np.float64],
) -> bytes:
    """Return a ``POSE`` message.

    Args:
        stamp_ns: nanoseconds.
        frame_id: coordinate frame of the pose.
        pose: x and y in metres and yaw in radians.
        covariance: (6, 6) of x, y, z and the rotations about them.

    Raises:
        MessageError: the stamp is out of range: in ROS its seconds are int32.
    """
    kinds = _typestore().types
    x, y, yaw = pose
    turned = kinds["geometry_msgs/msg/Quaternion"](
        x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2))
    )
    at = kinds["geometry_msgs/msg/Pose"](
        position=kinds["geometry_msgs/msg/Point"](x=x, y=y, z=0.0), orientation=turned
    )
    uncertain = kinds["geometry_msgs/msg/PoseWithCovariance"](
        pose=at, covariance=np.ascontiguousarray(covariance, np.float64).ravel()
    )
    return _encode(POSE, kinds[POSE](header=_header(stamp_ns, frame_id), pose=uncertain))


def diagnostics_message(stamp_ns: int, statuses: Iterable[Status]) -> bytes:
    """Return a ``DIAGNOSTICS`` message.

    Raises:
        MessageError: the stamp is out of range: in ROS its seconds are int32.
    """
    kinds = _typestore().types
    key_value = kinds["diagnostic_msgs/msg/KeyValue"]
    reported = [
        kinds["diagnostic_msgs/msg/DiagnosticStatus"](
            level=status.level,
            name=status.name,
            message=status.message,
            hardware_id=status.hardware,
            values=[key_value(key=key, value=value) for key, value in status.values.items()],
        )
        for status in statuses
    ]
    return _encode(DIAGNOSTICS, kinds[DIAGNOSTICS](header=_header(stamp_ns, ""), status=reported))


def _header(stamp_ns: int, frame_id: str) -> Any:
    seconds, nanoseconds = divmod(stamp_ns, _NS)
    if not -(2**31) <= seconds < 2**31:
        raise MessageError(f"a stamp of {seconds} s is out of range for ROS")
    kinds = _typestore().types
    stamp = kinds["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def _encode(kind: str, message: object) -> bytes:
    return bytes(_typestore().serialize_cdr(message, kind, little_endian=True))
