"""``placefield add`` and ``placefield drop`` on maps on disk."""

import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from command_lines import Run

from placefield.maps.manifest import read_identified, read_manifest

# A command whose files take their time to reach the disk.
SLOWLY = """
import time
from placefield.maps import store
store.sync = lambda file: time.sleep(60)
from placefield_tools.cli.main import main
main()
"""


ADD = ["add", "{route}", "{drive}"]
DROP = ["drop", "{route}", "1"]
BUILD = ["build", "{drive}", "-o", "{route}", "--overwrite", "--channels", "1"]


def files_of(folder: Path) -> dict[str, bytes]:
    files = (file for file in folder.rglob("*") if file.is_file())
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def arrays_of(folder: Path) -> dict[str, bytes]:
    return {name: held for name, held in files_of(folder).items() if name.endswith(".npy")}


@pytest.fixture
def route(map_path: Path, tmp_path: Path) -> Path:
    return shutil.copytree(map_path, tmp_path / "route.pfmap")


@pytest.fixture
def writing(
    request: pytest.FixtureRequest, route: Path, query_dir: Path
) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is in the middle of writing a new version; by default it adds a drive."""
    words = getattr(request, "param", ADD)
    given = (word.format(route=route, drive=query_dir) for word in words)
    command = [sys.executable, "-c", SLOWLY, *given]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            patience = time.monotonic() + 120
            while not list(route.parent.glob(".route.pfmap.*/new/features/*.npy")):
                assert process.poll() is None
                assert time.monotonic() < patience
                time.sleep(0.02)
            yield process
        finally:
            process.kill()


def test_a_drive_is_added_and_dropped(
    placefield: Run, route: Path, query_dir: Path, tmp_path: Path
) -> None:
    before, (_, digest) = files_of(route), read_identified(route)
    other = tmp_path / "dusk.pfmap"
    added = placefield("add", route, query_dir, "--name", "dusk", "-o", other)
    assert added.code == 0, added.err
    assert f"{other}: 60 places, of which 0 are new; " in added.out
    assert files_of(route) == before
    manifest = read_manifest(other)
    assert [record.name for record in manifest.traverses][1:] == ["dusk"]
    assert [(one.change, one.drive, one.before) for one in manifest.history] == [
        ("added", "dusk", digest)
    ]
    printed = placefield("inspect", other, "-o", tmp_path / "segments.png").out
    assert f"history  dusk added (before: {digest})" in printed
    assert " by dusk)" in printed
    in_place = placefield("add", route, query_dir, "--name", "dusk")
    assert in_place.code == 0, in_place.err
    assert files_of(route) == files_of(other)
    dropped = placefield("drop", route, "dusk")
    assert dropped.code == 0, dropped.err
    assert arrays_of(route) == {name: held for name, held in before.items() if name[-4:] == ".npy"}
    assert [one.change for one in read_manifest(route).history] == ["added", "dropped"]


def test_a_killed_command_leaves_the_map_and_nothing_that_blocks_the_next(
    placefield: Run, route: Path, query_dir: Path, writing: subprocess.Popen[bytes]
) -> None:
    before = files_of(route)
    writing.kill()
    writing.wait()
    assert files_of(route) == before
    assert list(route.parent.glob(".route.pfmap.*"))
    added = placefield("add", route, query_dir)
    assert added.code == 0, added.err
    assert os.listdir(route.parent) == [route.name]


@pytest.mark.parametrize(
    ("writing", "others"), [(ADD, [BUILD, DROP]), (BUILD, [ADD, BUILD])], indirect=["writing"]
)
def test_of_two_at_once_the_second_is_refused_in_one_line(
    placefield: Run,
    route: Path,
    query_dir: Path,
    writing: subprocess.Popen[bytes],
    others: list[list[str]],
) -> None:
    before = files_of(route)
    for command in others:
        refused = placefield(*(word.format(route=route, drive=query_dir) for word in command))
        assert refused.code == 1
        line = f"placefield: {route}: another process is changing it; try again when it is done"
        assert refused.err.splitlines() == [line]
    assert writing.poll() is None
    assert files_of(route) == before


def test_a_full_disk_leaves_the_map_as_it_was(route: Path, query_dir: Path) -> None:
    before = files_of(route)
    full = subprocess.run(
        [sys.executable, "-m", "placefield_tools", "add", route, query_dir],
        capture_output=True,
        text=True,
        timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000)),
    )
    assert full.returncode == 1
    assert full.stderr.splitlines()[-1] == (
        f"placefield: {route}: cannot write the map: the disk is full; free some space"
    )
    assert files_of(route) == before
    assert os.listdir(route.parent) == [route.name]


def empty(folder: Path, query: Path) -> Path:
    folder.mkdir()
    return folder


def broken(folder: Path, query: Path) -> Path:
    shutil.copytree(query, folder)
    sorted(folder.iterdir())[7].write_bytes(b"no image")
    return folder


def in_reverse(folder: Path, query: Path) -> Path:
    folder.mkdir()
    for number, file in enumerate(sorted(query.iterdir(), reverse=True)):
        shutil.copy(file, folder / f"{number:04}{file.suffix}")
    return folder


def missing(folder: Path, query: Path) -> Path:
    return folder


@pytest.mark.parametrize("make", [empty, broken, in_reverse, missing])
def test_a_bad_drive_is_one_line_and_leaves_the_map_as_it_was(
    placefield: Run,
    route: Path,
    query_dir: Path,
    tmp_path: Path,
    make: Callable[[Path, Path], Path],
) -> None:
    before, drive = files_of(route), make(tmp_path / "drive", query_dir)
    refused = placefield("add", route, drive)
    assert refused.code == 1
    assert drive.name in refused.err.splitlines()[-1]
    assert "Traceback" not in refused.err
    assert files_of(route) == before


def test_a_damaged_map_and_a_taken_output_are_named(
    placefield: Run, route: Path, query_dir: Path, tmp_path: Path
) -> None:
    taken = placefield(
        "add", route, query_dir, "-o", shutil.copytree(route, tmp_path / "other.pfmap")
    )
    assert "other.pfmap: is there already; choose another name" in taken.err
    file = route / "places" / "stamps.npy"
    file.write_bytes(file.read_bytes()[:-1] + b"x")
    damaged = placefield("add", route, query_dir)
    assert damaged.code == 1
    assert f"{file}: damaged: its checksum is wrong" in damaged.err
