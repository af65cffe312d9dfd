"""The calibration of a camera in a message: ``CameraInfo`` of ROS, or that of Foxglove."""

from typing import Any

import numpy as np

from placefield.features.calibration import Calibration
from placefield.features.camera_file import calibration_of

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

RECTIFIED = (
    "the images are rectified, and CameraInfo is of the images before; give --camera a YAML file "
    "with the matrix of projection_matrix and no distortion, or the topic image_raw"
)
"""What is wrong with the ``CameraInfo`` of rectified images."""

_FIELDS = ("width", "height", "distortion_model")
_MATRICES = ("k", "K", "d", "D")  # in ROS 2; in ROS 1 and Foxglove
_ROI = ("width", "height")


def camera_info_topic(images: str) -> str:
    """Return the topic of the ``CameraInfo`` of a topic of images, as image_transport names it.

    It is ``NAMESPACE/camera_info``, for ``NAMESPACE/image_raw`` and
    ``NAMESPACE/image_raw/compressed``.
    """
    namespace, _, _ = images.removesuffix("/compressed").rpartition("/")
    return f"{namespace}/camera_info"


def is_rectified(images: str) -> bool:
    """Return whether a topic of images is of rectified ones, as image_proc names it.

    The ``CameraInfo`` beside it is of the images before they were rectified.
    """
    name = images.removesuffix("/compressed").rpartition("/")[2]
    return name.startswith("image_rect")


def calibration_of_message(message: Any) -> Calibration:
    """Return the calibration that a message says, as rosbags or a reader of MCAP has read it.

    Raises:
        ValueError: it is none; the reason begins with the field.
    """
    given = {name: getattr(message, name) for name in _FIELDS if hasattr(message, name)}
    for name in _MATRICES:
        if hasattr(message, name):
            given[name] = np.asarray(getattr(message, name), np.float64).tolist()
    if hasattr(message, "roi"):
        given["roi"] = {name: getattr(message.roi, name) for name in _ROI}
    return calibration_of(given)
