"""The names of a camera's topics, as image_transport and image_proc give them."""

import pytest

from placefield.ros.camera_info import camera_info_topic, is_rectified


@pytest.mark.parametrize(
    ("images", "beside", "rectified"),
    [
        ("/camera/image_raw", "/camera/camera_info", False),
        ("/camera/image_raw/compressed", "/camera/camera_info", False),
        ("/robot/front/image", "/robot/front/camera_info", False),
        ("/image_raw", "/camera_info", False),
        ("/camera/image_rect", "/camera/camera_info", True),
        ("/camera/image_rect_color/compressed", "/camera/camera_info", True),
    ],
)
def test_the_camera_info_is_in_the_namespace_of_the_images(
    images: str, beside: str, rectified: bool
) -> None:
    assert camera_info_topic(images) == beside
    assert is_rectified(images) == rectified
