import cv2
import numpy as np
import pytest

from placefield.errors import SourceError
from placefield.features.frames import Frame
from placefield.features.images import decode
from placefield_tools.sources import Source, open_source
from placefield_tools.sources.distance_sampled import DistanceSampled


class Odometer(Source):
    """Frames of which only the odometry is known."""

    count = None

    def __init__(self, odometry, *, live=False):
        self.live = live
        self.closed = False
        self._odometry = odometry

    def __iter__(self):
        for index, metres in enumerate(self._odometry):
            yield Frame(index, 0, f"{index}.png", b"", odometry_m=metres)

    def close(self):
        self.closed = True


def test_a_drive_of_varying_speed_is_aligned_to_the_reference_when_it_is_spaced(tmp_path):
    fast, slow = np.arange(0, 20) / 10, np.arange(200, 400) / 100
    stop = np.full(30, 4.0)
    travelled = np.concatenate([fast, slow, stop, 4 + fast])
    for at, metres in enumerate(travelled):
        cv2.imwrite(str(tmp_path / f"{at}.png"), np.full((8, 8), round(10 * metres), np.uint8))
    rows = [f"{at}.png,{metres:.2f}" for at, metres in enumerate(travelled)]
    (tmp_path / "frames.csv").write_text("\n".join(["file,odometry", *rows]))

    with open_source(str(tmp_path), spacing_m=0.1) as source:
        for _ in range(2):
            places = [int(decode(frame.image).mean()) for frame in source]
            assert places == list(range(60))  # the reference has a frame every 0.1 m


def test_a_frame_without_odometry_is_named_and_so_is_the_column():
    spaced = DistanceSampled(Odometer([0.0, 1.0, None]), 1)
    with pytest.raises(
        SourceError, match=r"^2\.png: .*--spacing.*column odometry, --odometry-topic or --poses$"
    ):
        list(spaced)


def test_it_is_as_live_as_its_source_and_closes_it():
    assert DistanceSampled(Odometer([], live=True), 1).live
    source = Odometer([])
    with DistanceSampled(source, 1) as spaced:
        assert not spaced.live
    assert source.closed
