"""``placefield ros``: the gateway to ROS 2."""

from pathlib import Path
from typing import Annotated

import typer

from placefield_tools.cli import options, options_frames


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("ros")(_ros)


def _ros(
    topic: Annotated[
        str, typer.Option(metavar="TOPIC", help="topic of images: CompressedImage or Image")
    ],
    map_path: Annotated[
        Path | None,
        typer.Argument(
            metavar="MAP",
            help="a map: NAME.pfmap; without, no poses are published",
            show_default=False,
        ),
    ] = None,
    odometry: Annotated[
        str | None,
        typer.Option(metavar="TOPIC", help="topic of nav_msgs/Odometry", show_default="none"),
    ] = None,
    spacing: options_frames.Spacing = None,
    camera: options_frames.Camera = None,
    domain: Annotated[int, typer.Option(envvar="ROS_DOMAIN_ID", min=0, help="domain of ROS 2")] = 0,
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    metrics_port: options.MetricsPort = None,
    lineage: options.Lineage = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Read a run's frames from ROS 2, and publish poses to ROS 2. This host needs no ROS.

    ROS must use rmw_zenoh (jazzy or later). Connect its router to the router of this bus:
    'placefield up MAP --connect tcp/HOST:7447', or 'placefield router --connect tcp/HOST:7447'.

    Input: images are a live stream with the stamps of their headers. New images replace old ones if
    the services are too slow. Odometry gives the metres travelled between images. If the map was
    built with --spacing, give the same --spacing here. If the map has a camera's view, --camera is
    the camera of the images; without it, the topic camera_info beside them says it.

    Output, if MAP has poses: known matches of the rule filter on /placefield/RUN/pose, and known
    smoothed matches on /placefield/RUN/smoothed_pose (geometry_msgs/PoseWithCovarianceStamped, in
    the frame "map"). Once a second, the status of the services on /diagnostics
    (diagnostic_msgs/DiagnosticArray).

    Examples:
      placefield ros day.pfmap --topic /camera/image_raw/compressed --odometry /odom --spacing 0.5
    """
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield_services.map_versions import MapVersions
    from placefield_services.ros_gateway import Topics, run_ros

    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, monitoring__port=metrics_port
    )
    calibration = options_frames.calibration_of(camera, topic)
    topics = Topics(domain, topic, odometry, spacing, calibration)
    versions = None if map_path is None else MapVersions(map_path, lineage=lineage)
    run_ros(versions, topics, effective, stop_of_service())
    leave()
