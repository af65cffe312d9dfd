"""Images of ROS 2, used at equal distances."""

import queue
from pathlib import Path

from cdr_by_hand import compressed_image, odometry
from hosting import PATIENCE_S, Host, Listener, wait_until

from placefield.bus.messages import OdometryMessage
from placefield.bus.ros_node import RosNode
from placefield.ros.ros_messages import COMPRESSED_IMAGE, ODOMETRY

CAMERA, ODOM = "/camera/image_raw/compressed", "/odom"


def await_left_out(listener: Listener, count: int) -> None:
    wait_until(lambda: listener.count("replay", "left_out") == count, "the image is left out")


def test_images_are_used_every_so_many_metres_whatever_the_speed(
    logs: Path, map_path: Path, query_dir: Path
) -> None:
    frames = sorted(query_dir.iterdir())
    way = [0.0, 0.5, 1.0, 2.25, 2.5, 4.0]
    used = [0, 2, 3, 5]
    flags = "--ros", CAMERA, "--ros-odometry", ODOM, "--ros-spacing", "1"
    metres: queue.SimpleQueue[float] = queue.SimpleQueue()
    with Host(logs, map_path, "--workers", "1", *flags) as host, host.listener() as listener:
        listener.bus.subscribe_raw(
            listener.keys.odometry,
            lambda _, payload: metres.put(OdometryMessage.decode(payload).metres),
        )
        robot = RosNode(listener.bus, 0, "/robot", "camera")
        images, positions = (
            robot.publisher(CAMERA, COMPRESSED_IMAGE),
            robot.publisher(ODOM, ODOMETRY),
        )
        left_out = 0
        for number, (file, at) in enumerate(zip(frames, way, strict=False)):
            positions.put(odometry([at, 0, 0]))
            assert metres.get(timeout=PATIENCE_S) == at
            images.put(compressed_image((number, 0), file.read_bytes()))
            if number in used:
                ((header, _),) = listener.answers(first=used.index(number), count=1)
                assert header.stamp_ns == number * 10**9
            else:
                left_out += 1
                await_left_out(listener, left_out)
