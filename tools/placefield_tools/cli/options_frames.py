"""Options about the frames of a source and their poses."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from placefield.maps.trajectory import PoseAxes

if TYPE_CHECKING:
    from placefield.features.calibration import Calibration

Spacing = Annotated[
    float | None,
    typer.Option(
        metavar="METRES",
        help="use one frame per so many metres, by odometry",
        show_default="every frame",
    ),
]
Start = Annotated[
    int, typer.Option("--start", metavar="N", help="number of the first frame, from 0")
]
Stop = Annotated[
    int | None,
    typer.Option(
        "--stop", metavar="N", help="number of the frame after the last", show_default="the end"
    ),
]
Stride = Annotated[int, typer.Option("--stride", metavar="N", help="use every N-th frame")]
LeaveOutBad = Annotated[
    bool,
    typer.Option("--leave-out-bad", help="build without frames that are missing or cannot be read"),
]
Topic = Annotated[
    str | None,
    typer.Option(
        metavar="TOPIC", help="image topic of a recording", show_default="the only image topic"
    ),
]
OdometryTopic = Annotated[
    str | None,
    typer.Option(
        metavar="TOPIC",
        help="pose topic of a recording: Odometry, PoseStamped or NavSatFix; none: no poses",
        show_default="the only pose topic, if there is one",
    ),
]
PoseFile = Annotated[
    Path | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="poses of the frames: TUM, joined by stamp if the frames have stamps, or KITTI, a "
        "line per frame",
        show_default=False,
    ),
]
Camera = Annotated[
    Path | None,
    typer.Option(
        "--camera",
        metavar="FILE",
        help="calibration of the camera: YAML of ROS or OpenCV, or a recording with CameraInfo; "
        "the frames are rectified",
        show_default="used as they are",
    ),
]
QueryCamera = Annotated[
    Path | None,
    typer.Option(
        "--query-camera",
        metavar="FILE",
        help="calibration of the camera of QUERY, if it is another than that of the frames of REF; "
        "only what both see is used",
        show_default="--camera",
    ),
]
PoseAxesOption = Annotated[
    PoseAxes | None,
    typer.Option(
        "--pose-axes",
        help="axes of --poses: x-forward for a vehicle (y to the left), z-forward for a camera (x "
        "to the right)",
        show_default="TUM x-forward, KITTI z-forward",
    ),
]


def calibration_of(camera: Path | None, images: str | None = None) -> "Calibration | None":
    """Return the calibration that ``--camera`` names, see ``calibration_in``; None without it."""
    if camera is None:
        return None
    from placefield_tools.sources.calibration_files import calibration_in

    return calibration_in(camera, images)
