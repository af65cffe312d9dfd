"""Opening a source of any kind: the kind is recognised by the text that a user gives."""

import logging
import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from placefield.errors import SourceError
from placefield.features.distance_sampler import check_spacing
from placefield.features.frames import Frame
from placefield.maps.trajectory import PoseAxes
from placefield.plugins import has_plugin, load_plugin
from placefield_tools.sources.calibrated import Calibrated
from placefield_tools.sources.calibration_files import calibration_in
from placefield_tools.sources.camera import Camera
from placefield_tools.sources.descriptor_files import is_descriptor_file
from placefield_tools.sources.descriptors import Descriptors, holds_descriptors
from placefield_tools.sources.distance_sampled import DistanceSampled
from placefield_tools.sources.folder import IMAGE_SUFFIXES, Folder
from placefield_tools.sources.frame_content import check_images
from placefield_tools.sources.one_drive import OneDrive, in_order_of_time
from placefield_tools.sources.pose_files import read_pose_file
from placefield_tools.sources.pose_line_check import PoseLineCheck
from placefield_tools.sources.recording_files import is_recording, not_installed, recordings_in
from placefield_tools.sources.secrets import without_secrets
from placefield_tools.sources.source import Ended, Source
from placefield_tools.sources.video import Video
from placefield_tools.sources.with_odometry import WithOdometry
from placefield_tools.sources.with_poses import WithPoses

if TYPE_CHECKING:
    from placefield_tools.sources.recording import Recording
log = logging.getLogger(__name__)

_DEVICE = re.compile(r"(?:camera:|/dev/video)(\d+)", re.ASCII)
_URL = re.compile(r"(?:rtsps?|https?)://.+", re.IGNORECASE)

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9_.-]*):")
"""The scheme of a source from another package."""

_UNFINISHED = (".active", ".part", ".partial", ".tmp")
"""Suffixes of files that a recorder or a download has not finished."""


@dataclass(frozen=True)
class Parts:
    """The selected topics and frames of a source, and files about them beside it.

    Attributes:
        topic: topic of the images of a recording; None: the only one.
        odometry_topic: topic of the poses of a recording, ``none`` for no poses; None: the only
            one, if there is exactly one.
        poses: a file of the frames' poses; None: the source's own poses.
        pose_axes: axes of that file; None: the usual axes of its format.
        start: index of the first frame.
        stop: index after the last frame; None: the end of the source.
        stride: step from one frame to the next.
        camera: a file with the calibration of the camera, or a recording, see ``calibration_in``;
            None: it is not known.
    """

    topic: str | None = None
    odometry_topic: str | None = None
    poses: Path | None = None
    pose_axes: PoseAxes | None = None
    start: int = 0
    stop: int | None = None
    stride: int = 1
    camera: Path | None = None


NO_PARTS = Parts()


def open_source(
    where: str | Sequence[str],
    *,
    spacing_m: float | None = None,
    metres: Callable[[], float | None] | None = None,
    parts: Parts = NO_PARTS,
    stop: threading.Event | None = None,
) -> Source:
    """Open a folder of images, a video file, a recording, descriptors, or a camera.

    Several sources, or a folder of recordings, are the parts of one drive. They are read in
    sequence, in the order of their stamps if all have some, and otherwise in the given order.

    A recording is a ROS bag or an MCAP file. Descriptors are a ``.npy``, ``.npz`` or ``.h5`` file,
    or a folder of ``.npy`` or ``.npz`` files, see ``Descriptors``. A camera is ``camera:0`` or
    ``/dev/video0``, or on the network ``rtsp://…`` or ``http://…``. ``NAME:…`` is a source of
    another package, with the entry point ``NAME`` in ``placefield.sources``.

    Args:
        where: the source, or the parts of one drive.
        spacing_m: metres between frames, by odometry (see ``DistanceSampled``); None: every frame.
        metres: gives the odometry of a camera's frames, None if there is no new reading.
        parts: selects topics and frames.
        stop: ends the frames, also while a camera is away.

    Raises:
        SourceError: there is no such source, it cannot be read, or ``spacing_m`` or ``parts`` does
            not fit. That a video ends before ``start`` is found only when it is read, because its
            container's count may be wrong.
        ConfigError: a library that reads the source is not installed, or the camera's file is
            refused, see ``calibration_in``.
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
        if not isinstance(where, str) and len(where) == 1:
            (where,) = where
        if isinstance(where, str):
            source = _open(where, start, stride, parts, stop)
        else:
            source = _open_parts(where, start, stride, parts, stop)
            where = name_of(where)
    except OSError as error:
        shown = without_secrets(where if isinstance(where, str) else name_of(where))
        raise SourceError(f"{shown}: cannot be read ({error.strerror})") from error
    if parts.poses is None and parts.pose_axes is not None:
        raise SourceError(f"--pose-axes {parts.pose_axes}: needs a file of poses; give --poses")
    if parts.poses is not None:
        source = _with_pose_file(source, where, parts)
    if parts.stop is not None:
        source = Ended(source, start, parts.stop, stride)
    if parts.camera is not None:
        check_images(source, f"--camera {parts.camera}")
        source = Calibrated(source, calibration_in(parts.camera, parts.topic))
    if source.live and metres is not None:
        source = WithOdometry(source, metres)
    return source if spacing_m is None else DistanceSampled(source, spacing_m)


def _open(
    where: str, start: int, stride: int, parts: Parts, stop: threading.Event | None
) -> Source:
    path = Path(where)
    if is_recording(path):
        return _open_recordings(where, [path], start, stride, parts, stop)
    if recordings := recordings_in(path):
        return _open_recordings(where, recordings, start, stride, parts, stop)
    if parts.topic is not None or parts.odometry_topic is not None:
        shown = without_secrets(where)
        raise SourceError(f"{shown}: has no topics; leave out --topic and --odometry-topic")
    if device := _DEVICE.fullmatch(where):
        return Camera(int(device[1]), start=start, stride=stride, stop=stop)
    if _URL.fullmatch(where):
        return Camera(where, start=start, stride=stride, stop=stop)
    scheme = _SCHEME.match(where)
    if scheme and not path.exists() and has_plugin("placefield.sources", scheme[1]):
        opened: Source = load_plugin("placefield.sources", scheme[1])(
            where, start=start, stride=stride, stop=stop
        )
        return opened
    return _open_path(path, start, stride, stop)


def name_of(parts: Sequence[str]) -> str:
    """Return the name of a source, or of a drive in several parts: the first and the last."""
    return parts[0] if len(parts) == 1 else f"{parts[0]} to {parts[-1]}"


def is_descriptor_source(path: Path) -> bool:
    """Return whether a source is a file of descriptors, or a folder of such files."""
    if is_descriptor_file(path):
        return True
    return path.is_dir() and holds_descriptors(path)


def _open_parts(
    wheres: Sequence[str], start: int, stride: int, parts: Parts, stop: threading.Event | None
) -> Source:
    """Open the parts of one drive."""
    name = name_of(wheres)
    if all(is_recording(Path(where)) for where in wheres):
        paths = [Path(where) for where in wheres]
        return _open_recordings(name, paths, start, stride, parts, stop)
    opened = [_open(where, 0, 1, parts, stop) for where in wheres]
    for where, source in zip(wheres, opened, strict=True):
        if source.live:
            raise SourceError(f"{without_secrets(where)}: a camera cannot be a part of a drive")
    if all(source.span is not None for source in opened):
        opened = [opened[number] for number in in_order_of_time(name, opened)]
    return OneDrive(opened, name, start=start, stride=stride)


def _open_recordings(
    name: str,
    paths: Sequence[Path],
    start: int,
    stride: int,
    parts: Parts,
    stop: threading.Event | None,
) -> Source:
    """Open the recordings of one drive, whose poses form one trajectory."""
    try:
        from placefield_tools.sources.recorded_poses import with_poses
        from placefield_tools.sources.ros_recording import mixed_files
    except ModuleNotFoundError as missing:
        raise not_installed(name, missing) from None
    if len(paths) == 1:
        paths = mixed_files(paths[0]) or paths
    if len(paths) == 1:
        one = _open_recording(paths[0], start, stride, parts, stop)
        return with_poses(one, [one], parts.odometry_topic)
    opened = [_open_recording(path, 0, 1, parts, stop) for path in paths]
    recordings = [opened[number] for number in in_order_of_time(name, opened)]
    drive = OneDrive(recordings, name, start=start, stride=stride)
    return with_poses(drive, recordings, parts.odometry_topic)


def _open_recording(
    path: Path, start: int, stride: int, parts: Parts, stop: threading.Event | None
) -> "Recording":
    try:
        from placefield_tools.sources.mcap_recording import lists_topics, open_mcap_recording
        from placefield_tools.sources.ros_recording import open_ros_recording
    except ModuleNotFoundError as missing:
        raise not_installed(str(path), missing) from None
    opened = open_mcap_recording if lists_topics(path) else open_ros_recording
    return opened(path, parts.topic, start=start, stride=stride, stop=stop)


def _open_path(path: Path, start: int, stride: int, stop: threading.Event | None) -> Source:
    shown = without_secrets(str(path))  # it may be a URL with a misspelt scheme
    if is_descriptor_source(path):
        return Descriptors(path, start=start, stride=stride, stop=stop)
    if path.is_dir():
        return Folder(path, start=start, stride=stride, stop=stop)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise SourceError(f"{shown}: is a single image; give the folder of images")
    if path.suffix.lower() in _UNFINISHED:
        raise SourceError(
            f"{shown}: is being written, or was cut off; stop the recorder, or repair the file "
            "(rosbag reindex, ros2 bag reindex, mcap recover), and remove this suffix"
        )
    if path.is_file():
        return Video(path, start=start, stride=stride, stop=stop)
    raise SourceError(
        f"{shown}: no such folder or file; give a folder of images, a video, a recording "
        "(.bag, .mcap, a folder of ROS 2), descriptors (.npy, .npz, .h5), camera:0 or rtsp://…"
    )


def _with_pose_file(source: Source, where: str, parts: Parts) -> Source:
    """Join frames and poses by stamp, or by number if the frames or the poses have no stamps."""
    poses, start, stride = parts.poses, parts.start, parts.stride
    assert poses is not None
    if source.live:
        raise SourceError(f"--poses {poses}: a camera has no recorded poses; leave it out")
    file = read_pose_file(poses, parts.pose_axes)
    total = len(file.poses)
    is_counted = not isinstance(source, Video)  # a video's count is an estimate
    if file.numbered and is_counted and source.count != len(range(start, total, stride)):
        raise SourceError(
            f"--poses {poses}: has {total} lines; {where} has another number of frames"
        )
    if not file.numbered and not source.stamped:
        if is_counted and source.count != len(range(start, total, stride)):
            raise SourceError(
                f"--poses {poses}: has {total} lines; {where} has another number of frames, and no "
                "stamps to join them by: give it a frames.csv with the column stamp"
            )
        log.warning("%s: the frames have no stamps: line i is used for frame i", poses)
        file = file.by_number()

    if file.numbered:
        source = PoseLineCheck(source, str(poses), total, stride)

    def key(frame: Frame) -> int:
        return file.key(frame.index, frame.stamp_ns)

    return WithPoses(source, file.trajectory, str(poses), key=key)
