"""Frames to benchmark with."""

import numpy as np

from placefield.features.images import decode
from placefield_tools.bench.street_frames import street_frames


def test_every_frame_is_another_picture_of_the_size_asked_for() -> None:
    frames = street_frames(40, size=(320, 240))
    assert len(set(frames)) == 40
    assert {decode(frame).shape for frame in frames} == {(240, 320, 3)}


def test_the_same_frames_come_every_time() -> None:
    assert street_frames(3) == street_frames(3)


def test_a_shifted_drive_shows_nearly_the_same() -> None:
    (frame, later), (shifted, _) = street_frames(2), street_frames(2, shift=20)
    assert decode(frame).shape == (480, 640, 3)
    difference = np.abs(decode(shifted).astype(float) - decode(later)).mean()
    assert difference < 1 < np.abs(decode(frame).astype(float) - decode(later)).mean()
