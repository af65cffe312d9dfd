"""``placefield add``: a later drive to a map."""

from typing import Annotated

import typer

from placefield_tools.cli import options, options_frames, options_map


def add_to(app: typer.Typer) -> None:
    """Add the command."""
    app.command("add")(_add)


def _add(
    map_path: options.MapPath,
    drive: Annotated[
        str, typer.Argument(metavar="DRIVE", help="a folder, video, recording or descriptors")
    ],
    output: options_map.ChangedMap = None,
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="name of the drive in the map", show_default="DRIVE"),
    ] = None,
    start: options_frames.Start = 0,
    stop: options_frames.Stop = None,
    stride: options_frames.Stride = 1,
    leave_out_bad: options_frames.LeaveOutBad = False,
    spacing: options_frames.Spacing = None,
    topic: options_frames.Topic = None,
    odometry_topic: options_frames.OdometryTopic = None,
    poses: options_frames.PoseFile = None,
    pose_axes: options_frames.PoseAxesOption = None,
    camera: options_frames.Camera = None,
) -> None:
    """Add a later drive to a map: how the places look in it, and stretches that are new.

    The frames are aligned to the places of the map, by poses or by recognition. A frame that shows
    a place in another light becomes a further look of it. A stretch that the map does not have
    becomes a route of its own, with links to the places before and after it. The drive must show
    the route: 30% of its frames, or of the places. 'placefield drop' takes it out again.

    The frames are described as those of the map are, so its settings hold, and none is given here.

    The new version of the map replaces the old one in an instant, or is written to --output.

    Examples:
      placefield add route.pfmap night/
      placefield add route.pfmap rain.mcap --topic /camera/image_raw -o route-rain.pfmap
    """
    from placefield.maps.map_lock import open_locked
    from placefield.maps.store import save_map
    from placefield_tools.build.added_drive import add_drive
    from placefield_tools.inspect.map_facts import traverse_line
    from placefield_tools.sources import Parts

    output = options_map.changed_map(map_path, output)
    parts = Parts(topic, odometry_topic, poses, pose_axes, start, stop, stride, camera)
    with open_locked(map_path) as opened:
        added = add_drive(
            opened,
            drive,
            name or drive,
            spacing_m=spacing,
            parts=parts,
            leave_out_bad=leave_out_bad,
        )
        save_map(added.map, output)
    print(traverse_line(added.map.traverses[-1]))
    print(
        f"{output}: {added.map.places.count} places, of which {added.places} are new; "
        f"{added.looks} new looks, {added.pruned} would have added nothing"
    )
    if added.left_out:
        print(
            f"{added.left_out} frames of new stretches are left out: the map knows the metres "
            "between its places, and the drive has none; give --odometry-topic or --poses"
        )
