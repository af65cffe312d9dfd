"""The CameraInfo beside the images of ROS says their camera, where the map has a camera's view."""

from pathlib import Path

import pytest
from cdr_by_hand import camera_info, compressed_image
from hosting import Host, placefield, refusal, wait_until
from lenses import BENT

from placefield.bus.ros_node import RosNode
from placefield.config import Config
from placefield.maps.store import save_map
from placefield.ros.camera_info import CAMERA_INFO
from placefield.ros.ros_messages import COMPRESSED_IMAGE
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.build.used_part import AskedPart
from placefield_tools.sources import Parts

IMAGES, INFO = "/camera/image_raw/compressed", "/camera/camera_info"
CONFIG = Config.model_validate({"scales": {"channels": 1}, "metric": {"kind": "identity"}})


@pytest.fixture(scope="module")
def view_map(made_up: Path, reference_dir: Path, cameras: tuple[Path, Path]) -> Path:
    """A map of the view that both cameras see."""
    straight, bent = cameras
    images, path = AskedPart(query_cameras=[bent]), made_up / "view.pfmap"
    parts = Parts(camera=straight)
    save_map(build_from([str(reference_dir)], CONFIG, parts=parts, images=images), path)
    return path


def test_images_are_rectified_from_the_first_camera_info_on(
    logs: Path, view_map: Path, bent_dir: Path
) -> None:
    (fx, fy), (cx, cy) = BENT.focal, BENT.centre
    matrix = fx, 0, cx, 0, fy, cy, 0, 0, 1
    said = camera_info((BENT.height, BENT.width), "equidistant", matrix, BENT.k)
    files = sorted(bent_dir.iterdir())[:30]
    with (
        Host(logs, view_map, "--workers", "1", "--ros", IMAGES) as host,
        host.listener() as listener,
    ):
        robot = RosNode(listener.bus, 0, "/robot", "camera")
        images, infos = (
            robot.publisher(IMAGES, COMPRESSED_IMAGE),
            robot.publisher(INFO, CAMERA_INFO),
        )
        images.put(compressed_image((0, 0), files[0].read_bytes()))
        listener.answers(count=1)
        wait_until(lambda: listener.count("featurizer", "unreadable") == 1, "it has no camera")
        for number, file in enumerate(files[1:], start=1):
            infos.put(said)
            images.put(compressed_image((number, 0), file.read_bytes()))
            ((_, match),) = listener.answers(first=number, count=1)
        assert match.known
        assert abs(match.place - 29) <= 3
        assert listener.count("featurizer", "unreadable") <= 2
        assert listener.count("replay", "malformed") == 0


def test_rectified_images_of_ros_need_a_file(view_map: Path, endpoint: str) -> None:
    refused = placefield("ros", view_map, "--topic", "/camera/image_rect", "--endpoint", endpoint)
    assert "--topic /camera/image_rect: the images are rectified" in refusal(refused)
