from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest

from placefield.errors import SourceError
from placefield.evaluation.protocols import Protocol, drive_of
from placefield.features.frames import Frame
from placefield.features.images import decode
from placefield_tools.sources import open_source
from placefield_tools.sources.resampled import ResampledTraverse
from placefield_tools.sources.source import Source


class Pixels(Source):
    """Frames in pixels, as a video gives them, with an odometry."""

    def __init__(self, count: int, *, live: bool = False) -> None:
        self.live = live
        self.count = count
        self.images = np.random.default_rng(count).integers(0, 256, (count, 16, 16, 3), np.uint8)

    def __iter__(self) -> Iterator[Frame]:
        for index, image in enumerate(self.images):
            yield Frame(index, index * 250_000_000, f"{index}", image, odometry_m=float(index))


def shown(frame: Frame) -> bytes:
    assert isinstance(frame.image, bytes)
    return decode(frame.image).tobytes()


@pytest.mark.parametrize("protocol", [p for p in get_args(Protocol) if p != "aligned"])
def test_frames_come_as_the_drive_has_them_and_time_goes_on(protocol: Protocol) -> None:
    query, other = Pixels(50), Pixels(20)
    drive = drive_of(protocol, 50, foreign_count=20, seed=2)
    images = [
        (other if foreign else query).images[frame].tobytes()
        for frame, foreign in zip(drive.frames, drive.foreign, strict=True)
    ]

    resampled = ResampledTraverse(query, protocol, other=other, seed=2)

    assert resampled.query_count == 50
    assert resampled.count == len(images)
    for _ in range(2):
        frames = list(resampled)
        pairs = zip(frames, images, drive.repeated, strict=True)
        assert all((shown(frame) == image) != repeated for frame, image, repeated in pairs)
        assert [frame.index for frame in frames] == list(range(len(images)))
        assert [frame.stamp_ns for frame in frames] == [
            index * 250_000_000 for index in range(len(images))
        ]
        if drive.odometry is not None:
            assert [frame.odometry_m for frame in frames] == drive.odometry.tolist()


@pytest.mark.parametrize(
    ("protocol", "known"), [("speed", True), ("sparse", True), ("reverse", True), ("kidnap", False)]
)
def test_odometry_counts_the_way_that_is_driven_forth_or_back_and_none_that_it_is_carried(
    protocol: Protocol, known: bool
) -> None:
    resampled = ResampledTraverse(Pixels(50), protocol, seed=2)
    steps = np.abs(np.diff(resampled.drive.frames))
    if not known:
        steps[resampled.drive.jumps - 1] = 0
        assert len(resampled.drive.jumps)
    assert [frame.odometry_m for frame in resampled] == [0, *np.cumsum(steps).tolist()]


def test_on_another_route_odometry_goes_on_and_where_nobody_knows_there_is_none() -> None:
    class Gaps(Pixels):
        def __iter__(self) -> Iterator[Frame]:
            for frame in super().__iter__():
                yield replace(frame, odometry_m=None) if frame.index == 10 else frame

    resampled = ResampledTraverse(Gaps(50), "off-route", other=Pixels(200), seed=2)
    drive, metres, expected = resampled.drive, 0, [0]
    for at in range(1, len(drive.frames)):
        metres += int(drive.foreign[at] == drive.foreign[at - 1])
        expected.append(metres)
    (unknown,) = np.flatnonzero(~drive.foreign & (drive.frames == 10))
    readings = [frame.odometry_m for frame in resampled]
    assert readings == [None if at == unknown else m for at, m in enumerate(expected)]


class Smooth(Pixels):
    """Frames without much detail, as a camera gives them."""

    def __init__(self, count: int) -> None:
        super().__init__(count)
        coarse = np.random.default_rng(0).uniform(60, 200, (count, 4, 5, 3)).astype(np.float32)
        large = [cv2.resize(image, (320, 240), interpolation=cv2.INTER_CUBIC) for image in coarse]
        self.images = np.stack(large).clip(20, 235).astype(np.uint8)


def test_a_stop_is_the_same_picture_but_for_the_sensors_noise_and_never_the_same_bytes() -> None:
    query = Smooth(80)
    resampled = ResampledTraverse(query, "speed", seed=10, every=2)
    frames = list(resampled)

    assert resampled.drive.repeated.sum() >= 3
    for at in np.flatnonzero(resampled.drive.repeated):
        image = frames[at].image
        assert isinstance(image, bytes)
        assert image.startswith(b"\xff\xd8")  # a JPEG
        original = query.images[resampled.drive.frames[at]].astype(np.float32)
        noise = decode(image).astype(np.float32) - original
        # Of a deviation of 2 in each colour, JPEG leaves that of grey and thins out the colours'.
        assert 0.6 < noise.mean(axis=2).std() < 2
        assert abs(noise.mean()) < 0.5
    images = [shown(frame) for frame in frames]
    assert len(set(images)) == len(images)
    assert images == [shown(frame) for frame in ResampledTraverse(query, "speed", seed=10, every=2)]


def test_a_frame_that_is_no_image_stays_so_where_the_vehicle_stands(tmp_path: Path) -> None:
    for number in range(80):
        (tmp_path / f"{number}.jpg").write_bytes(b"no image")
    with open_source(str(tmp_path)) as source:
        resampled = ResampledTraverse(source, "speed", seed=10, every=2)
    assert resampled.drive.repeated.any()
    assert {frame.image for frame in resampled} == {b"no image"}


def test_files_come_as_they_lie_on_the_disk(query_dir: Path) -> None:
    with open_source(str(query_dir)) as source:
        resampled = ResampledTraverse(source, "reverse", seed=0)
    files = sorted(query_dir.iterdir(), reverse=True)
    assert [frame.image for frame in resampled] == [file.read_bytes() for file in files]
    assert [frame.name for frame in resampled] == [
        f"{query_dir.name}/{file.name}" for file in files
    ]


def test_a_camera_cannot_be_driven_again() -> None:
    with pytest.raises(SourceError, match="record it"):
        ResampledTraverse(Pixels(5, live=True), "reverse", seed=0)
