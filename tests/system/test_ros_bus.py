"""ROS 2 on the bus, with an independent client."""

import math
import queue
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from shutil import copytree
from typing import Any

import cv2
import numpy as np
import pytest
from hosting import (
    PATIENCE_S,
    Answer,
    Host,
    Listener,
    answers_of,
    offline,
    placefield,
    refusal,
    wait_until,
)
from ros_definitions import COMPRESSED_IMAGE, DIAGNOSTICS, IMAGE, ODOMETRY, POSE
from ros_robot import Robot, open_robot

from placefield.bus.messages import OdometryMessage
from placefield.config import Config
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_tools.build.map_from_sources import build_from

DOMAIN = 3
CAMERA, ODOM = "/camera/image_raw/compressed", "/odom"
NS = 10**9
OK, WARN = 0, 1


@dataclass
class Ros:
    """A host, what it says on the bus, and a robot that speaks with it."""

    host: Host
    listener: Listener
    robot: Robot
    poses: list[Any] = field(default_factory=list)
    diagnostics: list[Any] = field(default_factory=list)
    metres: "queue.SimpleQueue[float]" = field(default_factory=queue.SimpleQueue)
    shown: int = 0

    def __post_init__(self) -> None:
        self.robot.subscribe("/placefield/default/pose", POSE, self.poses.append)
        self.robot.subscribe("/diagnostics", DIAGNOSTICS, self.diagnostics.append)
        self.listener.bus.subscribe_raw(
            self.listener.keys.odometry,
            lambda _, payload: self.metres.put(OdometryMessage.decode(payload).metres),
        )
        self._compressed = self.robot.publisher(CAMERA, COMPRESSED_IMAGE)
        self._plain = self.robot.publisher(CAMERA, IMAGE)
        self._odometry = self.robot.publisher(ODOM, ODOMETRY)

    def header(self, stamp_ns: int) -> Any:
        stamp = self.robot.made(
            "builtin_interfaces/msg/Time", sec=stamp_ns // NS, nanosec=stamp_ns % NS
        )
        return self.robot.made("std_msgs/msg/Header", stamp=stamp, frame_id="camera")

    def show(self, file: Path, stamp_ns: int) -> None:
        """Publish a frame as it lies in its file."""
        self.shown += 1
        data = np.frombuffer(file.read_bytes(), np.uint8)
        self._compressed.publish(header=self.header(stamp_ns), format="jpeg", data=data)

    def show_pixels(self, file: Path, stamp_ns: int) -> None:
        """Publish the same frame as its pixels."""
        self.shown += 1
        pixels = cv2.cvtColor(cv2.imread(str(file)), cv2.COLOR_BGR2RGB)
        self._plain.publish(
            header=self.header(stamp_ns),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding="rgb8",
            is_bigendian=0,
            step=3 * pixels.shape[1],
            data=pixels.ravel(),
        )

    def drive_to(self, x: float, y: float) -> None:
        """Publish where the robot is by its odometry."""
        made = self.robot.made
        at = made("geometry_msgs/msg/Point", x=x, y=y, z=0.0)
        turned = made("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        still = made("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        self._odometry.publish(
            header=self.header(0),
            child_frame_id="base_link",
            pose=made(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=made("geometry_msgs/msg/Pose", position=at, orientation=turned),
                covariance=np.zeros(36),
            ),
            twist=made(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=made("geometry_msgs/msg/Twist", linear=still, angular=still),
                covariance=np.zeros(36),
            ),
        )

    def spoil(self, payload: bytes) -> None:
        """Publish bytes on the camera's topic."""
        self.shown += 1
        self.robot.session.session.put(self._compressed.keyexpr, payload)

    def count(self, name: str) -> int:
        return self.listener.count("replay", name)

    @property
    def received(self) -> int:
        """How much of what was shown has come, or is counted as dropped."""
        return sum(map(self.count, ("frames", "malformed", "dropped_old")))

    def has_taken_all(self) -> bool:
        """Whether all that was shown has come, or is counted as dropped."""
        return self.received == self.shown

    def await_rest(self) -> None:
        """Wait until nothing comes any more: the robot's client may itself drop of a burst."""
        before = -1
        while before != self.received:
            before = self.received
            time.sleep(2.2)  # counts come once a second
        self.shown = before

    def levels(self, service: str) -> list[int]:
        """Return the levels of a service's statuses so far."""
        return [
            int(status.level)
            for message in self.diagnostics
            for status in message.status
            if status.name.startswith(f"placefield: {service} ")
        ]

    def statuses(self) -> dict[str, dict[str, str]]:
        """Return the values of the newest statuses, by service."""
        return {
            status.name.split()[1]: {pair.key: pair.value for pair in status.values}
            for message in self.diagnostics[-1:]
            for status in message.status
        }


@pytest.fixture(scope="module")
def posed_map(made_up: Path, reference_dir: Path) -> Path:
    """A map with poses: along a circle, a frame every metre."""
    folder = copytree(reference_dir, made_up / "posed")
    rows = ["file,x,y,yaw"]
    for number, file in enumerate(sorted(folder.glob("*.jpg"))):
        angle = number / 30
        x, y = 30 * math.sin(angle), -30 * math.cos(angle)
        rows.append(f"{file.name},{x:.6f},{y:.6f},{angle:.6f}")
    (folder / "frames.csv").write_text("\n".join(rows))
    config = Config.model_validate({"scales": {"channels": 2}, "metric": {"kind": "identity"}})
    path = made_up / "posed.pfmap"
    save_map(build_from([str(folder)], config), path)
    return path


@pytest.fixture(scope="module")
def ros(logs: Path, posed_map: Path) -> Iterator[Ros]:
    flags = "--workers", "1", "--ros", CAMERA, "--ros-odometry", ODOM, "--ros-domain", str(DOMAIN)
    with (
        Host(logs, posed_map, *flags) as host,
        host.listener() as listener,
        open_robot(host.endpoint, DOMAIN) as robot,
    ):
        yield Ros(host, listener, robot)


def test_the_robot_lists_the_topics(ros: Ros) -> None:
    topics = ros.robot.topics()
    assert topics["/placefield/default/pose"] == [POSE]
    assert topics["/placefield/default/smoothed_pose"] == [POSE]
    assert topics["/diagnostics"] == [DIAGNOSTICS]
    assert COMPRESSED_IMAGE in topics[CAMERA]
    assert topics[ODOM] == [ODOMETRY]


def test_each_frame_is_matched_and_its_pose_is_the_match_s(
    ros: Ros, posed_map: Path, query_dir: Path
) -> None:
    frames = sorted(query_dir.iterdir())
    stamps = [1_700_000_000 * NS + number * 50_000_007 for number in range(len(frames))]
    answers: list[Answer] = []
    for number, (file, stamp_ns) in enumerate(zip(frames, stamps, strict=True)):
        (ros.show if number % 3 else ros.show_pixels)(file, stamp_ns)
        answers += ros.listener.answers(first=number, count=1)
    placemap = open_map(posed_map)
    assert answers_of(answers) == offline(placemap, frames)
    assert [header.stamp_ns for header, _ in answers] == stamps
    assert all(header.live for header, _ in answers)
    known = [(header.stamp_ns, match) for header, match in answers if match.known]
    assert len(known) > len(frames) / 2
    wait_until(lambda: len(ros.poses) == len(known), "all poses have come")
    for (stamp_ns, match), pose in zip(known, ros.poses, strict=True):
        assert match.pose == placemap.places.pose(match.place)
        check_pose(pose, stamp_ns, match.pose)


def check_pose(message: Any, stamp_ns: int, pose: tuple[float, float, float]) -> None:
    stamp, at = message.header.stamp, message.pose.pose
    assert message.header.frame_id == "map"
    assert stamp.sec * NS + stamp.nanosec == stamp_ns
    yaw = 2 * math.atan2(at.orientation.z, at.orientation.w)
    assert (at.position.x, at.position.y) == pose[:2]
    assert yaw == pytest.approx(pose[2])
    covariance = message.pose.covariance.reshape(6, 6)
    assert 0.1 < covariance[0, 0] == covariance[1, 1] < 4**2  # metres; 4 are the reach


def test_of_a_burst_each_frame_is_answered_or_counted_as_dropped(ros: Ros, query_dir: Path) -> None:
    before = ros.shown
    for number, file in enumerate(sorted(query_dir.iterdir())):
        ros.show(file, number)
    ros.await_rest()
    assert before < ros.shown <= before + 60
    wait_until(
        lambda: (
            ros.listener.count("fuser", "matches") + ros.listener.count("featurizer", "gaps")
            == ros.count("frames")
        ),
        "each frame that has come is answered or was dropped",
    )


def test_garbage_is_counted_and_stops_nothing(ros: Ros, query_dir: Path) -> None:
    (gateway,) = ros.host.service("ros")
    garbage = [b"", b"\0\1\0\0", b"no CDR at all", b"\0\1\0\0" + b"\xff" * 1000]
    for payload in garbage:
        ros.spoil(payload)
    wait_until(ros.has_taken_all, "all of it is counted")
    assert ros.count("malformed") > 0
    wait_until(lambda: WARN in ros.levels("replay"), "the diagnostics warn of it")
    wait_until(lambda: ros.levels("replay")[-1] == OK, "it is over")
    ros.show(min(query_dir.iterdir()), 7 * NS)
    wait_until(ros.has_taken_all, "the next frame has come")
    assert ros.host.service("ros") == [gateway]
    assert ros.count("failed") == 0


def test_each_service_has_a_status_with_its_counts(ros: Ros) -> None:
    names = {"channel", "featurizer", "fuser", "mapserver", "replay"}
    wait_until(lambda: ros.statuses().keys() == names, "all services are reported")
    wait_until(
        lambda: ros.statuses()["fuser"]["matches"] == str(ros.listener.count("fuser", "matches")),
        "the counts are those of the bus",
    )


def test_odometry_goes_out_as_metres_travelled(ros: Ros) -> None:
    for x, y in ((5.0, 5.0), (8.0, 9.0), (8.0, 9.0), (8.0, 8.5)):
        ros.drive_to(x, y)
    assert [ros.metres.get(timeout=PATIENCE_S) for _ in range(4)] == [0.0, 5.0, 5.0, 5.5]


def test_a_run_has_no_second_source(ros: Ros, query_dir: Path) -> None:
    refused = placefield("replay", query_dir, "--endpoint", ros.host.endpoint)
    assert "has a replay already" in refusal(refused)
