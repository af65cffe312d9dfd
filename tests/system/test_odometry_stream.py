"""Odometry on its way from a source through real services."""

import queue
from collections import Counter
from pathlib import Path
from shutil import copytree

from cdr_by_hand import compressed_image, odometry
from hosting import PATIENCE_S, Host, Listener, answers_of, wait_until

from placefield.bus.inbox import Received
from placefield.bus.messages import FeatureMessage, OdometryMessage
from placefield.bus.ros_node import RosNode
from placefield.maps.map import Map
from placefield.recognizer import Recognizer
from placefield.ros.ros_messages import COMPRESSED_IMAGE, ODOMETRY

CAMERA, ODOM = "/camera/image_raw/compressed", "/odom"


def received_readings(listener: Listener) -> dict[int, float | None]:
    """Return what will hold the odometry of each frame that the featurizer passes on."""
    readings: dict[int, float | None] = {}

    def receive(received: Received) -> None:
        if not received.header.end:
            message = FeatureMessage.decode(received.payload)
            readings[received.header.sequence] = message.odometry_m

    listener.bus.subscribe(listener.keys.feature, receive, Counter())
    return readings


def test_odometry_of_a_folder_goes_with_every_frame_and_answers_are_those_given_offline(
    host: Host, listener: Listener, route_map: Map, damaged_dir: Path, tmp_path: Path
) -> None:
    folder = copytree(damaged_dir, tmp_path / "measured")
    files = sorted(folder.iterdir())
    rows = [f"{file.name},{number * 0.75}" for number, file in enumerate(files)]
    (folder / "frames.csv").write_text("\n".join(["file,odometry", *rows]))
    readings = received_readings(listener)
    host.replay(folder)
    answers = answers_of(listener.answers())
    wait_until(lambda: len(readings) == len(files), "all descriptors have come")
    assert readings == {number: number * 0.75 for number in range(len(files))}
    recognizer = Recognizer(route_map)
    matches = [recognizer.update(file, number * 0.75) for number, file in enumerate(files)]
    assert answers == [(match.place, match.score, match.missing) for match in matches]


def test_images_of_ros_carry_its_odometry_until_it_stops(
    logs: Path, map_path: Path, query_dir: Path
) -> None:
    frames = sorted(query_dir.iterdir())
    way = [0.0, 0.5, 0.5, None, None, 2.0]
    metres: queue.SimpleQueue[float] = queue.SimpleQueue()
    flags = "--ros", CAMERA, "--ros-odometry", ODOM
    with Host(logs, map_path, "--workers", "1", *flags) as host, host.listener() as listener:
        listener.bus.subscribe_raw(
            listener.keys.odometry,
            lambda _, payload: metres.put(OdometryMessage.decode(payload).metres),
        )
        readings = received_readings(listener)
        robot = RosNode(listener.bus, 0, "/robot", "camera")
        images = robot.publisher(CAMERA, COMPRESSED_IMAGE)
        positions = robot.publisher(ODOM, ODOMETRY)
        for number, (file, at) in enumerate(zip(frames, way, strict=False)):
            if at is not None:
                positions.put(odometry([at, 0, 0]))
                assert metres.get(timeout=PATIENCE_S) == at
            images.put(compressed_image((number, 0), file.read_bytes()))
            listener.answers(first=number, count=1)
        wait_until(lambda: len(readings) == len(way), "all descriptors have come")
    assert readings == dict(enumerate(way))
