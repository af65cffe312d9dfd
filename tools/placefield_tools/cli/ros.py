"""``placefield ros``: the gateway to ROS 2."""

from typing import Annotated

import typer

from placefield_tools.cli import options


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("ros")(_ros)


def _ros(
    map_path: options.MapPath,
    topic: Annotated[
        str, typer.Option(metavar="TOPIC", help="of images: CompressedImage or Image")
    ],
    odometry: Annotated[
        str | None,
        typer.Option(metavar="TOPIC", help="of nav_msgs/Odometry", show_default="none"),
    ] = None,
    spacing: options.Spacing = None,
    domain: Annotated[int, typer.Option(envvar="ROS_DOMAIN_ID", min=0, help="of ROS")] = 0,
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    metrics_port: options.MetricsPort = None,
    digest: options.Digest = None,
    log_json: options.LogJson = False,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Take a run's frames from ROS 2, and answer it with poses. No ROS is needed here.

    ROS is to speak rmw_zenoh (jazzy or later), and its router to be connected to this bus's:
    'placefield up MAP --connect tcp/HOST:7447', or 'placefield router --connect tcp/HOST:7447'.

    In: images, as a live stream with the stamps of their headers, old ones dropped for new ones
    where the services cannot follow; odometry, as the metres travelled, which go with the images.
    Of a map whose frames were spaced, space these by the same metres.

    Out, where the map has poses: matches that the rule filter knows, on /placefield/RUN/pose, and
    smoothed ones likewise, on /placefield/RUN/smoothed_pose
    (geometry_msgs/PoseWithCovarianceStamped, in the frame "map"). Out once a second: how the
    services stand, on /diagnostics (diagnostic_msgs/DiagnosticArray).

    Examples:
      placefield ros day.pfmap --topic /camera/image_raw/compressed --odometry /odom --spacing 0.5
    """
    from placefield_services.process import begin, leave, stop_of_service

    begin()
    from placefield.maps.opening import open_map
    from placefield_services.ros_gateway import Topics, run_ros

    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, monitoring__port=metrics_port
    )
    topics = Topics(domain, topic, odometry, spacing)
    placemap = open_map(map_path, channels=(), digest=digest)
    run_ros(placemap, topics, effective, stop_of_service())
    leave()
