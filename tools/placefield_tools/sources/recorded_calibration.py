"""The calibration of a camera in the messages of a recording, of ROS or Foxglove."""

from collections.abc import Iterable
from pathlib import Path

from placefield.errors import SourceError
from placefield.features.calibration import Calibration
from placefield.ros.camera_info import CAMERA_INFO, calibration_of_message
from placefield_tools.sources.mcap_recording import (
    lists_topics,
    messages_in_mcap,
    types_in_mcap,
)
from placefield_tools.sources.recorded_images import IMAGES
from placefield_tools.sources.recording import known_errors
from placefield_tools.sources.ros_recording import (
    messages_in_ros,
    mixed_files,
    types_in_ros,
)
from placefield_tools.sources.topics import Types, camera_topic

_CAMERAS = (CAMERA_INFO, "foxglove.CameraCalibration", "foxglove_msgs/msg/CameraCalibration")


def recorded_calibration(paths: Iterable[Path], images: str | None) -> Calibration:
    """Return the calibration that the first message of a camera's topic says.

    Args:
        paths: the recordings of one drive.
        images: topic of the camera's images; None: the only one.

    Raises:
        SourceError: a recording cannot be read, there is no such topic (see ``camera_topic``), or
            its message says no calibration.
    """
    paths = [file for path in paths for file in mixed_files(path) or [path]]
    types = {path: _types_in(path) for path in paths}
    every = {topic: kind for each in types.values() for topic, kind in each.items()}
    topic = camera_topic(str(paths[0]), every, _CAMERAS, IMAGES, images)
    path = next(path for path in paths if topic in types[path])
    messages_in = messages_in_mcap if lists_topics(path) else messages_in_ros
    with known_errors(path):
        first = next(messages_in(path, topic), None)
        if first is None:
            raise SourceError(f"{path}: {topic}: none of its messages can be parsed")
        try:
            return calibration_of_message(first[1])
        except ValueError as error:
            raise SourceError(f"{path}: {topic}: {error}") from None


def _types_in(path: Path) -> Types:
    return types_in_mcap(path) if lists_topics(path) else types_in_ros(path)
