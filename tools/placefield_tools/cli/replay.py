"""``placefield replay``: publishes the frames of a source."""

from collections import Counter
from typing import Annotated

import typer

from placefield_tools.cli import options, options_frames


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("replay")(_replay)


def _replay(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="a folder of frames, a video, a recording (.bag, .mcap, a ROS 2 folder), "
            "descriptors (.npy, .npz, .h5), or a camera: camera:0, rtsp://HOST/PATH or "
            "http://HOST/PATH",
        ),
    ],
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.01, help="frames per second", show_default="as fast as the services answer"
        ),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="repeat from the start")] = False,
    start: options_frames.Start = 0,
    stop: options_frames.Stop = None,
    stride: options_frames.Stride = 1,
    spacing: options_frames.Spacing = None,
    topic: options_frames.Topic = None,
    odometry_topic: options_frames.OdometryTopic = None,
    poses: options_frames.PoseFile = None,
    pose_axes: options_frames.PoseAxesOption = None,
    camera: options_frames.Camera = None,
    run: options.Run = None,
    endpoint: options.Endpoint = None,
    credentials: options.Credentials = None,
    config: options.ConfigFile = None,
    settings: options.Settings = None,
) -> None:
    """Stream frames to the services of a run.

    Folders, videos, recordings and descriptors are lossless: no frame is dropped. A camera is
    live: new frames replace old ones if the services are too slow, and replay waits for a camera
    that is gone.
    Frames carry odometry if there is any: from the recording, or what the vehicle publishes for a
    camera. --spacing uses this odometry.

    Examples:
      placefield replay frames/
      placefield replay drive.bag --topic /camera/image_raw/compressed --spacing 0.5
      placefield replay rtsp://192.168.0.10/stream
    """
    from placefield.bus.connecting import open_bus
    from placefield.bus.keys import Keys
    from placefield.errors import SourceError
    from placefield_services.process import stop_event
    from placefield_tools.replay.replay_source import replay
    from placefield_tools.replay.vehicle_odometry import Odometry
    from placefield_tools.sources import Parts, open_source
    from placefield_tools.sources.secrets import without_secrets

    effective = options.effective_config(
        config, settings, runs=run, bus__endpoint=endpoint, bus__credentials=credentials
    )
    keys = Keys(effective.run)
    stopped = stop_event()
    odometry = Odometry()
    opened = open_source(
        source,
        spacing_m=spacing,
        metres=odometry.metres,
        parts=Parts(topic, odometry_topic, poses, pose_axes, start, stop, stride, camera),
        stop=stopped,
    )
    with opened as frames, open_bus(effective.bus, stopped) as bus:
        odometry.listen(bus, keys)
        replayed = replay(frames, bus, effective, stopped, rate=rate, loop=loop and not frames.live)
    counts = Counter(replayed.unobserved) + frames.not_given
    faults = ", ".join(f"{count} {what}" for what, count in counts.items())
    print(f"{replayed.sent} frames replayed" + (f": {faults}" if faults else ""))
    if replayed.sent == counts["unreadable"] and (replayed.sent or counts["missing"]):
        raise SourceError(
            f"{without_secrets(source)}: none of its frames could be read; check the files, and "
            "whether the map is of such frames"
        )
