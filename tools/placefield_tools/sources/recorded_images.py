"""Images in the messages of recordings, of ROS or Foxglove, in any encoding."""

import base64
import logging
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from placefield.errors import ConfigError, FrameError, SourceError
from placefield.ros.image_messages import decode_image
from placefield.ros.ros_messages import IMAGES as ROS_IMAGES
from placefield.ros.ros_messages import image_of
from placefield_tools.common.natural_sort import counted
from placefield_tools.sources.compressed_video import VideoDecoder
from placefield_tools.sources.recording import Stamped

log = logging.getLogger(__name__)

_COMPRESSED = ("foxglove.CompressedImage", "foxglove_msgs/msg/CompressedImage")
_RAW = ("foxglove.RawImage", "foxglove_msgs/msg/RawImage")
_VIDEO = ("foxglove.CompressedVideo", "foxglove_msgs/msg/CompressedVideo")

IMAGES = (*ROS_IMAGES, *_COMPRESSED, *_RAW, *_VIDEO)
"""The types of messages that are images; those of Foxglove in its own encodings and in ROS's."""

Read = Callable[[], tuple[int, Any]]
"""Reads the stamp of a message, in ns, and its fields."""


def check_decoder(path: Path, kind: str) -> None:
    """Refuse a recording of compressed video if it cannot be decoded.

    Raises:
        ConfigError: PyAV is not installed.
    """
    if kind in _VIDEO:
        try:
            VideoDecoder()
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None


def images_of(name: str, kind: str, messages: Iterator[Read]) -> Iterator[Callable[[], Stamped]]:
    """Yield a decoder of the image of each message of a topic.

    Args:
        name: of the topic, used in messages.
        kind: type of the messages, one of ``IMAGES``.
        messages: readers of the messages, in order.
    """
    if kind in _VIDEO:
        return _video(name, messages)
    return (partial(_image, kind, read) for read in messages)


def _image(kind: str, read: Read) -> Stamped:
    stamp_ns, message = read()
    read_image = image_of if kind in ROS_IMAGES else _foxglove_image_of
    try:
        return stamp_ns, read_image(kind, message)
    except FrameError as error:
        return stamp_ns, error


def _video(name: str, messages: Iterator[Read]) -> Iterator[Callable[[], Stamped]]:
    """Yield the images of a video from its first key frame on; each is decoded after the others."""
    decoder = VideoDecoder()
    left_out = 0
    has_begun = False
    failed: FrameError | str = "no key frame in it"
    for read in messages:
        stamp_ns, message = read()
        picture: NDArray[np.uint8] | FrameError | None
        try:
            picture = decoder.update(message.format, _data_of(message))
        except FrameError as error:
            picture = error
        if not has_begun and not isinstance(picture, np.ndarray):
            left_out += 1
            failed = picture or failed
            continue
        if not has_begun and left_out:
            log.warning("%s: begins with %s without an image", name, counted(left_out, "message"))
        has_begun = True
        if picture is None:
            picture = FrameError("this message of a video holds no image")
        yield partial(_stamped, stamp_ns, picture)
    if not has_begun:
        raise SourceError(f"{name}: {failed}")


def _stamped(stamp_ns: int, picture: NDArray[np.uint8] | FrameError) -> Stamped:
    return stamp_ns, picture


def _foxglove_image_of(kind: str, message: Any) -> bytes | NDArray[np.uint8]:
    data = _data_of(message)
    if kind in _COMPRESSED:
        return data
    return decode_image(message.height, message.width, message.encoding, False, message.step, data)


def _data_of(message: Any) -> bytes:
    """Return the data of a message; JSON holds them as base64."""
    data = message.data
    if isinstance(data, str):
        return base64.b64decode(data, validate=True)
    return bytes(data)
