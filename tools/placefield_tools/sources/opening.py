"""Guess what kind of source a person means."""

import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from placefield.errors import ConfigError, SourceError
from placefield.features.frames import Frame
from placefield.features.spacing import check_spacing
from placefield_tools.sources.camera import Camera
from placefield_tools.sources.folder import IMAGE_SUFFIXES, Folder
from placefield_tools.sources.located import Located
from placefield_tools.sources.metered import Metered
from placefield_tools.sources.pose_files import read_pose_file
from placefield_tools.sources.secrets import without_secrets
from placefield_tools.sources.source import Ended, Source
from placefield_tools.sources.spaced import Spaced
from placefield_tools.sources.video import Video

_DEVICE = re.compile(r"(?:camera:|/dev/video)(\d+)", re.ASCII)
_URL = re.compile(r"(?:rtsps?|https?)://.+", re.IGNORECASE)

_RECORDINGS = (".bag", ".db3", ".mcap")
_UNFINISHED = (".active", ".part", ".partial", ".tmp")
"""Of files that a recorder or a download has not finished."""

_BAG_FOLDER = "metadata.yaml"


@dataclass(frozen=True)
class Parts:
    """Which parts of a recording are meant, and what lies beside a source.

    Attributes:
        topic: of images in a recording; None: the only one.
        odometry_topic: of poses in a recording, ``none`` for none; None: the only one, if it is.
        poses: a file of the frames' poses; None: those that the source has itself.
        start: the first frame.
        stop: the frame before which it ends; None: at its end.
        stride: from one frame to the next.
    """

    topic: str | None = None
    odometry_topic: str | None = None
    poses: Path | None = None
    start: int = 0
    stop: int | None = None
    stride: int = 1


NO_PARTS = Parts()


def open_source(
    where: str,
    *,
    spacing_m: float | None = None,
    metres: Callable[[], float | None] | None = None,
    parts: Parts = NO_PARTS,
    stop: threading.Event | None = None,
) -> Source:
    """Open a folder of images, a video file, a recording, or a camera.

    A recording is a bag of ROS or an MCAP file. A camera is ``camera:0`` or ``/dev/video0``, or of
    the network ``rtsp://…`` or ``http://…``.

    The source gives the frames that ``parts`` says, and of these, if asked to, only one every
    ``spacing_m`` metres (see ``Spaced``). The odometry of a camera's frames is what
    ``metres`` tells, None where that is no news. ``stop`` ends the frames; a camera that is away is
    waited for until then.

    Raises:
        SourceError: nothing of the kind is there, it cannot be read, or ``spacing_m`` or ``parts``
            does not fit. A video tells only when it is read that it ends before ``start``: its
            container's count may be wrong.
        ConfigError: what reads it is not installed.
    """
    start, stride = parts.start, parts.stride
    if start < 0:
        raise SourceError(f"--start {start}: must be 0 or more")
    if parts.stop is not None and parts.stop <= start:
        raise SourceError(f"--stop {parts.stop}: must be more than --start, which is {start}")
    if stride < 1:
        raise SourceError(f"--stride {stride}: must be 1 or more")
    if spacing_m is not None:
        check_spacing(spacing_m)
    try:
        source = _open(where, start, stride, parts, stop)
    except OSError as error:
        shown = without_secrets(where)
        raise SourceError(f"{shown}: cannot be read ({error.strerror})") from error
    if parts.poses is not None:
        source = _located(source, where, parts.poses, start, stride)
    if parts.stop is not None:
        source = Ended(source, start, parts.stop, stride)
    if source.live and metres is not None:
        source = Metered(source, metres)
    return source if spacing_m is None else Spaced(source, spacing_m)


def _open(
    where: str, start: int, stride: int, parts: Parts, stop: threading.Event | None
) -> Source:
    path = Path(where)
    if _is_recording(path):
        return _open_recording(path, start, stride, parts, stop)
    if parts.topic is not None or parts.odometry_topic is not None:
        shown = without_secrets(where)
        raise SourceError(f"{shown}: has no topics: leave --topic and --odometry-topic out")
    if device := _DEVICE.fullmatch(where):
        return Camera(int(device[1]), start=start, stride=stride, stop=stop)
    if _URL.fullmatch(where):
        return Camera(where, start=start, stride=stride, stop=stop)
    return _open_path(path, start, stride, stop)


def _is_recording(path: Path) -> bool:
    if path.suffix.lower() in _RECORDINGS:
        return path.is_file()
    return (path / _BAG_FOLDER).is_file()


def _open_recording(
    path: Path, start: int, stride: int, parts: Parts, stop: threading.Event | None
) -> Source:
    try:
        from placefield_tools.sources.foxglove_recording import (
            holds_foxglove_images,
            open_foxglove_recording,
        )
        from placefield_tools.sources.ros_recording import open_ros_recording
    except ModuleNotFoundError as missing:
        raise ConfigError(f"{path} needs {missing.name}: pip install 'placefield[ros]'") from None
    is_foxglove = path.suffix.lower() == ".mcap" and holds_foxglove_images(path, parts.topic)
    opened = open_foxglove_recording if is_foxglove else open_ros_recording
    topics = parts.topic, parts.odometry_topic
    return opened(path, *topics, start=start, stride=stride, stop=stop)


def _open_path(path: Path, start: int, stride: int, stop: threading.Event | None) -> Source:
    shown = without_secrets(str(path))  # it may be a URL with a misspelt scheme
    if path.is_dir():
        return Folder(path, start=start, stride=stride, stop=stop)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise SourceError(f"{shown}: this would be one image; give the folder that it lies in")
    if path.suffix.lower() in _UNFINISHED:
        raise SourceError(
            f"{shown}: is still being written, or was cut off while it was; stop the recorder, or "
            "repair it (rosbag reindex, ros2 bag reindex, mcap recover), and give it its own name"
        )
    if path.is_file():
        return Video(path, start=start, stride=stride, stop=stop)
    raise SourceError(
        f"{shown}: no such folder or file; give a folder of images, a video, a recording "
        "(.bag, .mcap, a folder of ROS 2), camera:0 or rtsp://…"
    )


def _located(source: Source, where: str, poses: Path, start: int, stride: int) -> Source:
    if source.live:
        raise SourceError(f"--poses {poses}: a camera's frames are not there yet; leave it out")
    file = read_pose_file(poses)
    total = len(file.trajectory.stamps)
    is_counted = not isinstance(source, Video)  # whose count is an estimate
    if file.numbered and is_counted and source.count != len(range(start, total, stride)):
        raise SourceError(
            f"--poses {poses}: has {total} lines; {where} has another number of frames"
        )

    def key(frame: Frame) -> int:
        if file.numbered and frame.index >= total:
            raise SourceError(f"--poses {poses}: has {total} lines, and none for {frame.name}")
        return file.key(frame.index, frame.stamp_ns)

    return Located(source, file.trajectory, str(poses), key=key)
