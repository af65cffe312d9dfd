"""The commands of README and tutorials, run in order on made-up frames: they end well."""

import shutil
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from doc_commands import PROJECT, Sandbox, blocks
from lenses import pinhole
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

PAGES = (
    "README.md",
    "docs/tutorials/bag.md",
    "docs/tutorials/folders.md",
    "docs/tutorials/descriptors.md",
    "docs/tutorials/cameras.md",
)


@pytest.fixture
def sandbox_dir(tmp_path: Path, reference_dir: Path, query_dir: Path) -> Path:
    """What a reader has: drives of a route, as folders, recordings and videos, and cameras."""
    folder = tmp_path / "sandbox"
    folder.mkdir()
    shutil.copytree(reference_dir, folder / "day")
    shutil.copytree(query_dir, folder / "dusk")
    (folder / "demo").symlink_to(folder, target_is_directory=True)  # as the demo leaves them
    for drive in ("day", "dusk"):
        frames = [file.read_bytes() for file in sorted((folder / drive).iterdir())]
        write_video(folder / f"{drive}.mp4", frames)
        write_recording(folder / f"{drive}.mcap", frames)
    for camera, focal in (("front", 420), ("phone", 460)):
        pinhole(640, 480, focal).write(folder / f"{camera}.yaml")
    return folder


def write_video(file: Path, frames: list[bytes]) -> None:
    pictures = [cv2.imdecode(np.frombuffer(frame, np.uint8), cv2.IMREAD_COLOR) for frame in frames]
    height, width = pictures[0].shape[:2]
    video = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), 10, (width, height))
    for picture in pictures:
        video.write(picture)
    video.release()


def write_recording(file: Path, frames: list[bytes]) -> None:
    """Write a drive as ROS 2 records it: a frame and a position every 0.6 m, ten a second."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    bag = file.with_suffix("")  # ROS makes a folder with the file in it
    bag = bag.with_name(f"{bag.name}-bag")
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        image, odometry = "sensor_msgs/msg/CompressedImage", "nav_msgs/msg/Odometry"
        images = writer.add_connection("/camera/image_raw/compressed", image, typestore=store)
        places = writer.add_connection("/odom", odometry, typestore=store)
        for number, frame in enumerate(frames):
            nanoseconds = number * 10**8
            stamp = types["builtin_interfaces/msg/Time"](*divmod(nanoseconds, 10**9))
            header = types["std_msgs/msg/Header"](stamp, "map")
            data = types[image](header, "jpeg", np.frombuffer(frame, np.uint8))
            writer.write(images, nanoseconds, store.serialize_cdr(data, image))
            vector = types["geometry_msgs/msg/Vector3"]
            twist = types["geometry_msgs/msg/TwistWithCovariance"](
                types["geometry_msgs/msg/Twist"](vector(6.0, 0, 0), vector(0, 0, 0)), np.zeros(36)
            )
            pose = types["geometry_msgs/msg/PoseWithCovariance"](
                types["geometry_msgs/msg/Pose"](
                    types["geometry_msgs/msg/Point"](0.6 * number, 0.0, 0.0),
                    types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                ),
                np.zeros(36),
            )
            data = types[odometry](header, "base_link", pose, twist)
            writer.write(places, nanoseconds, store.serialize_cdr(data, odometry))
    (recorded,) = bag.glob("*.mcap")
    shutil.move(recorded, file)
    shutil.rmtree(bag)


@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_the_page_ends_well(page: str, sandbox_dir: Path, tmp_path: Path) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    with Sandbox(sandbox_dir, logs) as sandbox:
        for block in blocks(PROJECT / page):
            if block.is_run and block.language == "sh":
                sandbox.run(block)
            elif block.is_run and block.language == "python":
                sandbox.run_python(block.text, sys.executable)
