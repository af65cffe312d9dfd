"""A drive is explored by real processes; its map is saved and served, whoever dies meanwhile."""

import queue
import re
import signal
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest
from cdr_by_hand import compressed_image, odometry
from hosting import PATIENCE_S, Host, Listener, Process, placefield, refusal, wait_until
from hosting import Answer as Received
from laps import FRAMES, images_of_laps
from lenses import Lens
from numpy.typing import NDArray

import placefield as library
from placefield.bus.messages import OdometryMessage
from placefield.bus.ros_node import RosNode
from placefield.config import MatchingConfig
from placefield.features.extract import feature_of
from placefield.features.rectification import rectify, view_of
from placefield.maps.opening import open_map
from placefield.matching.exploring import Answer, Explorer
from placefield.ros.ros_messages import COMPRESSED_IMAGE, ODOMETRY
from placefield_services.mapper import drive_path, ended_path

IMAGES = images_of_laps()
SOON = 60  # frames
AGAIN = slice(90, 130)  # frames of the second lap

Said = tuple[int, float | None, float | None, bool | None]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The laps as files."""
    folder = tmp_path / "drive"
    folder.mkdir()
    for number, image in enumerate(IMAGES):
        cv2.imwrite(str(folder / f"{number:04}.png"), image)
    return folder


def said(answers: Sequence[Answer]) -> list[Said]:
    return [(each.place, each.probability, each.new, each.known) for each in answers]


def explored(lens: Lens | None = None) -> tuple[list[Said], list[Said]]:
    """Return what the library says of the laps, as a lens takes them, causal and smoothed."""
    describe, images = feature_of("gist").describe, IMAGES
    if lens is not None:
        view = view_of(lens.calibration)
        images = [rectify(image, lens.calibration, view) for image in IMAGES]
    explorer = Explorer(MatchingConfig())
    causal = [explorer.update(describe(image)) for image in images]
    smoothed = [*explorer.smoothed(), *explorer.finish()]
    return said(causal), said([each.answer for each in smoothed])


def kill(processes: list[psutil.Process], listener: Listener, service: str) -> None:
    """Kill the only process of a service, and wait for the next one."""
    before = listener.alive(service)
    for process in processes:
        process.kill()
    wait_until(lambda: listener.alive(service) - before, f"there is another {service}")
    wait_until(lambda: not listener.alive(service) & before, f"the first {service} is gone")


def test_a_drive_is_explored_as_the_library_does_and_its_map_is_served_whoever_is_killed(
    tmp_path: Path,
) -> None:
    path = tmp_path / "laps.pfmap"
    with Host(tmp_path, Path(f"--explore={path}")) as host, host.listener() as listener:
        answers: list[Received] = []

        def images() -> Iterator[NDArray[np.uint8]]:
            for number, image in enumerate(IMAGES):
                if number in (90, 110, 125):  # all frames before have been answered
                    answers.extend(listener.answers(len(answers), count=number - len(answers)))
                if number == 90:
                    kill(host.service("explore channel"), listener, "channel")
                if number == 110:
                    kill(host.service("explore mapper"), listener, "mapper")
                if number == 125:
                    kill(host.service("explore featurizer"), listener, "featurizer")
                yield image

        with library.connect(host.endpoint) as client:
            with Process(tmp_path, "listen", "--endpoint", host.endpoint) as listening:
                matches = [*client.stream(images())]
                wait_until(lambda: "end of stream" in listening.out, "the listener has it all")
                assert re.search(r"frame \d+: place of frame \d+, known, 99\.\d %", listening.out)
            answers += listener.answers(len(answers))
            stream = answers[0][0].stream
            smoothed = [match for _, match in listener.smoothed(stream)]
            for got, expected in zip((matches, smoothed), explored(), strict=True):
                assert [(m.place, m.probability, m.new, m.known) for m in got] == expected
            assert sum(match.known for match in smoothed) > 50
            assert not any(match.missing or match.forgotten for match in matches)

            wait_until(lambda: host.out.count("ready: ") == 2, "the map is served")
            placemap = open_map(path)
            assert placemap.places.count == FRAMES
            assert (placemap.places.same[AGAIN] < 70).all()
            assert not ended_path(path).exists()
            again = [*client.stream(IMAGES[:SOON])]
            assert [match.new for match in again] == [None] * SOON
            assert sum(bool(match.known) for match in again) > SOON / 2
            header, match = listener.next_match()
            assert (header.sequence, match and match.map) == (0, placemap.digest)
    assert not drive_path(path).exists()


def test_a_drive_of_a_camera_is_explored_rectified_and_its_describers_take_part(
    tmp_path: Path, folder: Path
) -> None:
    height, width = IMAGES[0].shape[:2]
    lens = Lens("pinhole", (-0.2, 0.02), width, height, (0.7 * width,) * 2, (width / 2, height / 2))
    camera, path = lens.write(tmp_path / "front.yaml"), tmp_path / "laps.pfmap"
    flags = Path(f"--explore={path}"), "--camera", camera, "--describers", "1"
    with Host(tmp_path, *flags) as host, host.listener() as listener:
        replayed = placefield("replay", folder, "--camera", camera, "--endpoint", host.endpoint)
        assert replayed.returncode == 0, replayed.stderr
        answers = listener.answers()
        matches = [match for _, match in answers]
        smoothed = [match for _, match in listener.smoothed(answers[0][0].stream)]
        for got, expected in zip((matches, smoothed), explored(lens), strict=True):
            assert [(m.place, m.probability, m.new, m.known) for m in got] == expected
        assert listener.count("describer", "received") > FRAMES / 3
        assert listener.count("featurizer", "described_here") < FRAMES / 3
        wait_until(lambda: host.out.count("ready: ") == 2, "the map is served")
    placemap = open_map(path)
    assert placemap.model.view == view_of(lens.calibration)
    assert placemap.places.count == FRAMES
    assert explored(lens) != explored()


def test_images_of_ros_are_explored_until_the_host_is_ended_and_the_map_has_their_metres(
    tmp_path: Path,
) -> None:
    path, camera, odom = tmp_path / "laps.pfmap", "/camera/compressed", "/odom"
    flags = Path(f"--explore={path}"), "--ros", camera, "--ros-odometry", odom
    metres: queue.SimpleQueue[float] = queue.SimpleQueue()
    with Host(tmp_path, *flags) as host, host.listener() as listener:
        listener.bus.subscribe_raw(
            listener.keys.odometry,
            lambda _, payload: metres.put(OdometryMessage.decode(payload).metres),
        )
        robot = RosNode(listener.bus, 0, "/robot", "camera")
        images = robot.publisher(camera, COMPRESSED_IMAGE)
        positions = robot.publisher(odom, ODOMETRY)
        answers: list[Received] = []
        for number, image in enumerate(IMAGES[:SOON]):
            positions.put(odometry([number / 2, 0, 0]))
            assert metres.get(timeout=PATIENCE_S) == number / 2
            images.put(compressed_image((number, 0), cv2.imencode(".png", image)[1].tobytes()))
            answers += listener.answers(first=number, count=1)
        wait_until(lambda: listener.count("mapper", "kept") == SOON, "the frames are kept")
        assert host.stop(signal.SIGINT) == 0
    matches = [match for _, match in answers]
    assert [(m.place, m.probability, m.new, m.known) for m in matches] == explored()[0][:SOON]
    places = open_map(path).places
    np.testing.assert_allclose(np.diff(places.travelled), 0.5)
    assert places.count == SOON


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_what_was_explored_becomes_a_map_when_the_host_is_ended(
    tmp_path: Path, folder: Path, number: signal.Signals
) -> None:
    path = tmp_path / "laps.pfmap"
    with Host(tmp_path, Path(f"--explore={path}")) as host, host.listener() as listener:
        with Process(
            tmp_path, "replay", folder, "--rate", "20", "--endpoint", host.endpoint
        ) as replay:
            listener.answers(count=SOON)
            replay.stop(signal.SIGKILL)
            wait_until(lambda: listener.count("mapper", "kept") >= SOON, "the frames are kept")
            code = host.stop(number)
        wait_until(lambda: not host.left_behind(), "the services have ended, too")
    if number == signal.SIGKILL:
        assert not path.exists()
        with Host(tmp_path, Path(f"--explore={path}")) as again:
            assert "channels" in again.out
            assert "has left its drive" in again.err
    else:
        assert code == 0, host.err
    assert SOON <= open_map(path).places.count < FRAMES
    assert [each.name for each in tmp_path.glob("laps.*")] == ["laps.pfmap"]


def test_nothing_is_explored_to_a_map_that_exists(tmp_path: Path, map_path: Path) -> None:
    assert "exists already" in refusal(placefield("up", "--explore", map_path))
