"""Files on a disk that takes no more: whole or not at all, and one line that names the file."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_after

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.errors import PlacefieldError
from placefield.files import write_whole, written_whole
from placefield.maps.digest import NO_DIGEST
from placefield.maps.geography import Origin
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield_tools.datasets.ground_truth import write_runs
from placefield_tools.datasets.sums import write_sums
from placefield_tools.plots import style
from placefield_tools.record.recorder_files import recorder_of
from placefield_tools.security.folders import write_credentials


def text(path: Path) -> None:
    write_whole(path, "x" * 5000)


def plot(path: Path) -> None:
    style.save(style.new_figure(3, 2, "title"), path)


def sums(path: Path) -> None:
    write_sums(path, {f"file {number}": "0" * 64 for number in range(100)})


def truth(path: Path) -> None:
    write_runs([(query, 0, 1) for query in range(1000)], path)


WRITERS: list[Callable[[Path], None]] = [text, plot, sums, truth]


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize("room", [0, 1, 1000])
@pytest.mark.parametrize("there", [None, b"as it was"])
def test_a_file_that_finds_no_room_is_as_it_was_and_named(
    tmp_path: Path, write: Callable[[Path], None], room: int, there: bytes | None
) -> None:
    file = tmp_path / "file"
    if there is not None:
        file.write_bytes(there)
    with full_after(room), pytest.raises(OSError, match="large") as refused:
        write(file)
    assert refused.value.filename == str(file)
    assert (file.read_bytes() if file.exists() else None) == there
    assert set(tmp_path.iterdir()) == ({file} if there is not None else set())
    write(file)
    assert file.stat().st_size > 1000
    assert list(tmp_path.iterdir()) == [file]


def test_a_file_has_the_rights_of_any_new_one_and_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    write_whole(tmp_path / "file", "text")
    assert (tmp_path / "file").stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "link").symlink_to("file")
    write_whole(tmp_path / "link", "other")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_text() == "other"


def test_a_device_is_written_to_as_it_is() -> None:
    with pytest.raises(OSError, match="No space"):
        write_whole(Path("/dev/full"), "text")
    write_whole(Path("/dev/null"), "text")
    assert Path("/dev/null").is_char_device()


def test_a_block_that_fails_leaves_nothing(tmp_path: Path) -> None:
    def fail() -> None:
        with written_whole(tmp_path / "file") as beside:
            beside.write_bytes(b"half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("room", [0, 10, 300])
@pytest.mark.parametrize("was_there", [False, True])
def test_credentials_that_find_no_room_leave_no_key_behind(
    tmp_path: Path, room: int, was_there: bool
) -> None:
    folder = tmp_path / "pki"
    if was_there:
        folder.mkdir()
    with full_after(room), pytest.raises(OSError, match="large") as refused:
        write_credentials(folder, [], days=1)
    assert Path(refused.value.filename).is_relative_to(folder)
    assert folder.exists() == was_there
    assert not was_there or not list(folder.iterdir())
    write_credentials(folder, [], days=1)
    assert all(file.stat().st_size for file in folder.rglob("*") if file.is_file())
    assert (folder / "ca-key.pem").stat().st_mode & 0o777 == 0o600
    assert str(folder) in (folder / "router" / "router.json5").read_text()
    assert "/." not in (folder / "router" / "router.json5").read_text().replace(str(folder), "")


def test_a_map_that_finds_no_room_leaves_the_one_that_was_there(
    route_map: Map, tmp_path: Path
) -> None:
    path = tmp_path / "route.pfmap"
    save_map(route_map, path)
    before = {file: file.read_bytes() for file in path.rglob("*") if file.is_file()}
    with full_after(2000), pytest.raises(PlacefieldError, match="disk is full"):
        save_map(route_map, path)
    assert {file: file.read_bytes() for file in path.rglob("*") if file.is_file()} == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".jsonl", ".csv", ".mcap", ".rrd"])
@pytest.mark.parametrize("room", [0, 1000, 8192])
def test_a_recording_that_finds_no_room_is_a_known_error_of_one_line(
    tmp_path: Path, suffix: str, room: int
) -> None:
    path = tmp_path / f"drive{suffix}"
    header = Header(stream="s", sequence=0, stamp_ns=0)
    match = MatchMessage(
        map=NO_DIGEST, place=1, score=0.5, probability=0.9, known=True, pose=(1.0, 2.0, 0.5)
    )
    rng = np.random.default_rng(1)
    rich = suffix in (".mcap", ".rrd")
    origin = Origin(52.0, 13.0) if rich else None

    def record() -> None:
        with recorder_of(path, origin=origin, frames=rich) as recorder:
            for sequence in range(300):
                at = header.of_frame(sequence)
                recorder.write_match(at, match)
                if rich:
                    recorder.write_frame(at, rng.bytes(500))

    with full_after(room), pytest.raises(PlacefieldError, match="written any more") as refused:
        record()
    assert str(refused.value).startswith(f"{path}: ")
    assert len(str(refused.value).splitlines()) == 1
    assert os.path.getsize(path) <= room
