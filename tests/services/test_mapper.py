"""The mapper keeps one drive whole, and hands it to services that missed it."""

import gc
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest
from bus_doubles import PeerCache, at_last, received
from exploring_drive import FRAMES, MODEL, about, features, message
from full_disk import full_after
from numpy.typing import NDArray

from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import CacheQuery, FeatureMessage, FrameMessage
from placefield.features.images import decode
from placefield.maps.drive_file import read_drive
from placefield_services import whole_stream
from placefield_services.mapper import Mapper, drive_path, ended_path

KEYS = Keys("test")
RAWS = features()


@pytest.fixture(autouse=True)
def ask_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(whole_stream, "_ASK_FOR_S", 0.0)


class Stage:
    """A mapper and what it counted."""

    def __init__(self, path: Path) -> None:
        self.elsewhere = PeerCache()
        self.counts: Counter[str] = Counter()
        self.mapper = Mapper(path, MODEL, None, self.elsewhere.fetch, self.counts)

    def show(self, header: Header, image: NDArray[np.uint8]) -> None:
        frame = FrameMessage(image=image)
        self.mapper.keep_image(received(KEYS.frame, header, frame))

    def describe(self, header: Header, payload: bytes = b"") -> None:
        at_last(lambda: self.mapper.accept(received(KEYS.feature, header, payload)))

    def drive(self, first: int, end: int, *, stream: str = "s") -> None:
        for sequence in range(first, end):
            header = about(sequence).model_copy(update={"stream": stream})
            self.show(header, np.full((20, 30), sequence, np.uint8))
            self.describe(header, message(RAWS[sequence]))
        if end == FRAMES:
            self.describe(about(FRAMES, end=True).model_copy(update={"stream": stream}))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "route.pfmap"


def test_the_drive_is_kept_whole_and_moves_at_its_end(path: Path) -> None:
    stage = Stage(path)
    stage.drive(0, FRAMES - 1)
    assert drive_path(path).exists()
    stage.drive(FRAMES - 1, FRAMES)
    assert not drive_path(path).exists()
    kept = [*read_drive(ended_path(path))]
    assert [frame.number for frame in kept] == [*range(FRAMES)]
    assert [frame.stamp_ns for frame in kept] == [10 * number for number in range(FRAMES)]
    for frame, raw in zip(kept, RAWS, strict=True):
        assert (frame.raw is None) == (raw is None)
        assert raw is None or np.array_equal(np.asarray(frame.raw), raw)
        assert abs(decode(frame.thumbnail).mean() - frame.number) < 2
    assert stage.counts["kept"] == FRAMES


def test_a_mapper_that_comes_back_goes_on_where_the_last_one_was_killed(path: Path) -> None:
    before = Stage(path)
    before.drive(0, 50)
    del before
    gc.collect()  # its file is closed, as when a process is killed
    after = Stage(path)
    for sequence in range(40, 70):
        after.elsewhere.kept[sequence] = about(sequence), message(RAWS[sequence])
    after.drive(70, FRAMES)
    kept = [*read_drive(ended_path(path))]
    assert [frame.number for frame in kept] == [*range(FRAMES)]
    assert after.counts["without_image"] == 20
    assert decode(kept[60].thumbnail).max() == 0


def test_a_query_for_past_features_is_answered_from_the_first_on(path: Path) -> None:
    stage = Stage(path)
    stage.drive(0, FRAMES)
    query = CacheQuery(stream="s", first=30, end=50)
    answers = [*stage.mapper.reply(query.encode())]
    assert [Header.decode(header) for _, header in answers] == [about(n) for n in range(30, 50)]
    for (payload, _), raw in zip(answers, RAWS[30:50], strict=True):
        assert payload == FeatureMessage(model=MODEL, descriptor=raw).encode()
    other = CacheQuery(stream="another", first=0, end=50)
    assert [*stage.mapper.reply(other.encode())] == []


def test_another_stream_ends_the_drive_and_is_not_kept(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stage = Stage(path)
    stage.drive(0, 60)
    stage.drive(0, 30, stream="another")
    assert len([*read_drive(ended_path(path))]) == 60
    assert stage.counts["left_out"] == 30
    assert caplog.text.count("explored, but not kept") == 1


def test_once_there_is_no_map_of_a_drive_the_next_is_kept(path: Path) -> None:
    stage = Stage(path)
    stage.drive(0, FRAMES)
    ended_path(path).unlink()
    stage.drive(0, FRAMES, stream="another")
    assert len([*read_drive(ended_path(path))]) == FRAMES


def test_on_a_full_disk_the_frames_before_are_kept_and_one_line_says_so(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    stage = Stage(path)
    stage.drive(0, 50)
    room = drive_path(path).stat().st_size + 100
    with full_after(room):
        stage.drive(50, 60)
    stage.drive(60, FRAMES)
    assert len([*read_drive(ended_path(path))]) == 50
    assert stage.counts["left_out"] == FRAMES - 50
    assert caplog.text.count("will end before frame 50") == 1


def test_an_image_that_cannot_be_read_has_no_thumbnail(path: Path) -> None:
    stage = Stage(path)
    stage.mapper.keep_image(received(KEYS.frame, about(0), FrameMessage(image=b"no image")))
    stage.describe(about(0), message(None))
    stage.describe(about(1, end=True))
    (kept,) = read_drive(ended_path(path))
    assert (kept.raw, kept.thumbnail) == (None, b"")


def test_a_thumbnail_is_small(path: Path) -> None:
    stage = Stage(path)
    stage.show(about(0), np.zeros((480, 640, 3), np.uint8))
    stage.describe(about(0), message(RAWS[0]))
    stage.describe(about(1, end=True))
    (kept,) = read_drive(ended_path(path))
    assert cv2.imdecode(np.frombuffer(kept.thumbnail, np.uint8), 1).shape == (120, 160, 3)
