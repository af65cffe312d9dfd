"""Untrusted archives: all of their files land in the folder, or none."""

import io
import shutil
import stat
import struct
import tarfile
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from placefield.errors import SourceError
from placefield_tools.datasets.unpacking import unpack

FRAMES = {"day/1.jpg": b"one", "day/2.jpg": b"two", "night/1.jpg": b"dark", "GT.npz": b"truth"}


def zip_of(path: Path, content: dict[str, bytes]) -> Path:
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return path


def tar_of(path: Path, content: dict[str, bytes]) -> Path:
    with tarfile.open(path, "w:gz" if path.suffix == ".gz" else "w") as archive:
        for name, data in content.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            archive.addfile(info, io.BytesIO(data))
    return path


def archive_of(path: Path, content: dict[str, bytes]) -> Path:
    return (zip_of if path.suffix == ".zip" else tar_of)(path, content)


def files_in(folder: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


@pytest.fixture(params=["frames.zip", "frames.tar", "frames.tar.gz"])
def archive(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return tmp_path / str(request.param)


def test_an_archive_becomes_the_folder(archive: Path, tmp_path: Path) -> None:
    unpack(archive_of(archive, FRAMES), tmp_path / "into")
    assert files_in(tmp_path / "into") == FRAMES


def test_a_folder_that_wraps_all_of_it_is_left_out(archive: Path, tmp_path: Path) -> None:
    content = {f"a/b/{name}": data for name, data in FRAMES.items()} | {"__MACOSX/a/._b": b"fork"}
    unpack(archive_of(archive, content), tmp_path / "into")
    assert files_in(tmp_path / "into") == FRAMES


@pytest.mark.parametrize(
    "name",
    [
        "../out",
        "day/../../out",
        "/out",
        "//out",
        "..\\out",
        "C:\\out",
        "C:out",
        "\\\\host\\share\\x",
    ],
)
def test_what_would_land_outside_is_refused_and_nothing_is_left(
    archive: Path, tmp_path: Path, name: str
) -> None:
    archive_of(archive, {"day/1.jpg": b"one", name: b"evil"})
    with pytest.raises(SourceError, match="would land outside the folder: not unpacked"):
        unpack(archive, tmp_path / "in" / "here" / "into")
    assert set(files_in(tmp_path)) == {archive.name}


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.FIFOTYPE])
def test_links_and_devices_in_a_tar_are_refused(tmp_path: Path, kind: bytes) -> None:
    with tarfile.open(tmp_path / "frames.tar", "w") as archive:
        archive.addfile(tarfile.TarInfo("day"))
        info = tarfile.TarInfo("link")
        info.type, info.linkname = kind, "day"
        archive.addfile(info)
    with pytest.raises(SourceError, match="'link' is a link or a device"):
        unpack(tmp_path / "frames.tar", tmp_path / "into")
    assert not (tmp_path / "into").exists()


def test_links_in_a_zip_are_refused(tmp_path: Path) -> None:
    info = ZipInfo("link")
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    with ZipFile(tmp_path / "frames.zip", "w") as archive:
        archive.writestr(info, "/etc/passwd")
    with pytest.raises(SourceError, match="'link' is a link or a device"):
        unpack(tmp_path / "frames.zip", tmp_path / "into")


def test_more_than_the_disk_has_room_for_is_refused_before_it_is_written(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    archive_of(archive, {"bomb": bytes(2_000_000)})
    usage = shutil.disk_usage(tmp_path)._replace(free=1_999_999)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    monkeypatch.setattr(shutil, "copyfileobj", None)
    with pytest.raises(SourceError, match="holds more than the disk has room for, at 'bomb'"):
        unpack(archive, tmp_path / "into")


def test_a_zip_bomb_gives_no_more_than_it_declares(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bomb = zip_of(tmp_path / "bomb.zip", {"bomb": bytes(5_000_000)})
    declared = struct.pack("<I", 5_000_000)
    bomb.write_bytes(bomb.read_bytes().replace(declared, struct.pack("<I", 1000)))
    written: list[int] = []
    copy = shutil.copyfileobj

    def counting(source: io.BytesIO, target: io.BytesIO) -> None:
        try:
            copy(source, target)
        finally:
            written.append(target.tell())

    monkeypatch.setattr(shutil, "copyfileobj", counting)
    with pytest.raises(SourceError, match="is damaged"):
        unpack(bomb, tmp_path / "into")
    assert written[0] <= 1000
    assert not (tmp_path / "into").exists()


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    suffix=st.sampled_from([".zip", ".tar", ".tar.gz"]),
    changes=st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 255)), max_size=6),
    length=st.integers(0, 10_000),
)
def test_a_damaged_archive_is_unpacked_within_the_folder_or_refused(
    tmp_path: Path, suffix: str, changes: list[tuple[int, int]], length: int
) -> None:
    shutil.rmtree(tmp_path)
    tmp_path.mkdir()
    archive = archive_of(tmp_path / f"frames{suffix}", FRAMES)
    data = bytearray(archive.read_bytes())
    for at, value in changes:
        data[at % len(data)] = value
    archive.write_bytes(data if length > len(data) else data[:length])
    try:
        unpack(archive, tmp_path / "into")
    except (SourceError, OSError):
        assert not (tmp_path / "into").exists()
    assert {entry.name for entry in tmp_path.iterdir()} <= {archive.name, "into"}
