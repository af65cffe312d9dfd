import math

import cv2
import numpy as np
import pytest
from cdr_by_hand import Cdr, compressed_image, image, odometry
from hypothesis import given
from hypothesis import strategies as st

from placefield.errors import MessageError
from placefield.ros.ros_messages import (
    COMPRESSED_IMAGE,
    IMAGE,
    ODOMETRY,
    WARN,
    Status,
    diagnostics_message,
    pose_message,
    read_image,
    read_position,
    type_hash,
)

PIXELS = np.random.default_rng(3).integers(0, 256, (9, 8, 3)).astype(np.uint8)
WELL = [
    (COMPRESSED_IMAGE, compressed_image((1, 2), b"a picture")),
    (IMAGE, image((1, 2), 9, 8, "bgr8", 24, PIXELS.tobytes())),
]


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_compressed_image_is_its_bytes_and_the_stamp_of_its_header(order: str) -> None:
    data = compressed_image((1_700_000_000, 250), b"\xff\xd8 a picture", order)
    assert read_image(COMPRESSED_IMAGE, data) == (1_700_000_000_000_000_250, b"\xff\xd8 a picture")


@pytest.mark.parametrize("order", ["<", ">"])
def test_an_image_is_its_pixels(order: str) -> None:
    padded = np.pad(PIXELS.reshape(9, -1), ((0, 0), (0, 3)))
    data = image((-1, 5), 9, 8, "rgb8", 27, padded.tobytes(), order)
    stamp_ns, pixels = read_image(IMAGE, data)
    assert stamp_ns == -999_999_995
    assert np.array_equal(pixels, cv2.cvtColor(PIXELS, cv2.COLOR_RGB2BGR))


@pytest.mark.parametrize("order", ["<", ">"])
def test_odometry_is_its_position(order: str) -> None:
    data = odometry([1.5, -2.25, 0.125], order)
    assert read_position(ODOMETRY, data).tolist() == [1.5, -2.25, 0.125]


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda: read_position(ODOMETRY, odometry([math.nan, 0, 0])),
        lambda: read_position(IMAGE, odometry([0, 0, 0])),
        lambda: read_image(ODOMETRY, odometry([0, 0, 0])),
        lambda: read_image(IMAGE, image((1, 2), 9, 8, "jpeg2000", 24, PIXELS.tobytes())),
        lambda: read_image(IMAGE, image((1, 2), 2**31, 2**31, "bgr8", 2**32 - 1, b"")),
        lambda: read_image(COMPRESSED_IMAGE, b""),
        lambda: pose_message(2**31 * 10**9, "map", (0, 0, 0), np.zeros((6, 6))),
    ],
)
def test_a_malformed_message_is_a_message_error(spoilt) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(MessageError):
        spoilt()


def complaint(kind: str, data: bytes) -> str:
    """Return the error text of a refused image; any other error fails the test."""
    try:
        read_image(kind, data)
    except MessageError as error:
        return str(error)
    return ""


@given(st.binary(max_size=300), st.sampled_from([b"", b"\0\1\0\0", b"\0\0\0\0"]))
def test_no_bytes_raise_anything_but_a_message_error(data: bytes, lead: bytes) -> None:
    for kind in (COMPRESSED_IMAGE, IMAGE):
        assert "\n" not in complaint(kind, lead + data)
    with pytest.raises(MessageError):  # 690 bytes are needed
        read_position(ODOMETRY, lead + data)


@given(st.sampled_from(WELL), st.data())
def test_no_spoilt_image_raises_anything_but_a_message_error(
    well: tuple[str, bytes], draw: st.DataObject
) -> None:
    kind, message = well
    spoilt = bytearray(message[: draw.draw(st.integers(0, len(message)))])
    for place in draw.draw(st.lists(st.integers(0, max(len(spoilt) - 1, 0)), max_size=4)):
        spoilt[place : place + 1] = draw.draw(st.binary(min_size=1, max_size=4))
    assert "\n" not in complaint(kind, bytes(spoilt))


def test_a_pose_is_written_as_the_specification_has_it() -> None:
    covariance = np.arange(36.0).reshape(6, 6)
    written = pose_message(3_000_000_004, "map", (1.5, -2.5, math.pi / 2), covariance)
    half = math.sqrt(0.5)
    expected = Cdr().header(3, 4, "map").put("d", 1.5, -2.5, 0, 0, 0, half, half, *range(36))
    assert len(written) == len(bytes(expected))
    start = len(bytes(Cdr().header(3, 4, "map")))
    assert written[:start] == bytes(expected)[:start]
    assert np.frombuffer(written[start:]) == pytest.approx(np.frombuffer(bytes(expected)[start:]))


def test_diagnostics_are_written_as_the_specification_has_them() -> None:
    statuses = [
        Status(WARN, "fuser", "2 late", "run", {"matches": "7", "late": "2"}),
        Status(0, "featurizer é", "", "", {}),
    ]
    expected = Cdr().header(-1, 999_999_999, "").put("I", 2)
    expected.put("B", 1).text("fuser").text("2 late").text("run")
    expected.put("I", 2).text("matches").text("7").text("late").text("2")
    expected.put("B", 0).text("featurizer é").text("").text("").put("I", 0)
    assert diagnostics_message(-1, statuses) == bytes(expected)


def test_the_hashes_of_types_are_those_of_ros_2_jazzy() -> None:
    """The expected hashes are those of a robot with that release."""
    assert type_hash(IMAGE) == (
        "RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
    )
    assert type_hash(COMPRESSED_IMAGE) == (
        "RIHS01_15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"
    )
