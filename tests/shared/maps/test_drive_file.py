"""The file of a drive keeps whole frames, whatever happens to the process and the disk."""

from pathlib import Path

import numpy as np
import pytest
from full_disk import full_after

from placefield.errors import MapError
from placefield.maps.drive_file import Drive, DriveFile, DriveFrame, read_drive

DRIVE = Drive("s", False, "0123456789abcdef")


def frame(number: int) -> DriveFrame:
    raw = np.random.default_rng(number).normal(size=8).astype(np.float32)
    return DriveFrame(number, 10 * number, 0.5 * number, raw, bytes([number] * 20))


def same(one: DriveFrame, other: DriveFrame) -> bool:
    return one._replace(raw=None) == other._replace(raw=None) and np.array_equal(
        np.asarray(one.raw), np.asarray(other.raw)
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "route.pfmap.drive"


@pytest.fixture
def written(path: Path) -> Path:
    """Frames 0 to 9, without the frame 4, and the frame 7 not observed."""
    file = DriveFile(path, DRIVE)
    for number in [0, 1, 2, 3, 5, 6, 7, 8, 9]:
        file.append(frame(number) if number != 7 else DriveFrame(7, 70, None, None, b""))
    file.close()
    return path


def test_frames_are_read_as_they_were_written_also_by_a_later_process(written: Path) -> None:
    file = DriveFile(written)
    assert file.drive == DRIVE
    assert file.next == 10
    assert [each.number for each in file.frames(2, 8)] == [2, 3, 5, 6, 7]
    assert [each.number for each in file.frames(8, 99)] == [8, 9]
    read = [*read_drive(written)]
    assert [each.number for each in read] == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    for one, other in zip(read, file.frames(0, 10), strict=True):
        assert same(one, other)
        assert same(one, frame(one.number)) == (one.number != 7)
    file.close()
    assert [*file.frames(0, 10)] == []


def test_a_frame_that_was_written_in_part_is_removed(
    written: Path, caplog: pytest.LogCaptureFixture
) -> None:
    whole = written.read_bytes()
    written.write_bytes(whole[:-5])
    file = DriveFile(written)
    assert "written in part" in caplog.text
    assert file.next == 9
    file.append(frame(9))
    file.close()
    assert written.read_bytes() == whole


def test_on_a_full_disk_the_frames_before_stay_and_the_file_is_named(written: Path) -> None:
    before = written.read_bytes()
    file = DriveFile(written)
    with full_after(len(before) + 30), pytest.raises(OSError, match="large") as refused:
        file.append(frame(10))
    assert refused.value.filename == str(written)
    assert written.read_bytes() == before
    file.append(frame(10))
    assert [each.number for each in file.frames(9, 11)] == [9, 10]


def test_one_process_at_a_time_has_a_drive_open(written: Path) -> None:
    file = DriveFile(written)
    with pytest.raises(MapError, match="another process"):
        DriveFile(written)
    file.close()
    DriveFile(written).close()


def test_a_drive_that_is_over_moves_and_can_still_be_read(written: Path, tmp_path: Path) -> None:
    file = DriveFile(written)
    file.end(tmp_path / "over")
    assert not written.exists()
    assert [each.number for each in file.frames(0, 3)] == [0, 1, 2]
    assert len([*read_drive(tmp_path / "over")]) == 9


@pytest.mark.parametrize("content", [b"", b"\xc1", b"text", b"\x93\x01\x02\x03", bytes(40)])
def test_a_file_of_no_drive_is_refused_and_stays(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(MapError, match="is no drive"):
        DriveFile(path)
    with pytest.raises(MapError, match="is no drive"):
        next(read_drive(path))
    assert path.read_bytes() == content
