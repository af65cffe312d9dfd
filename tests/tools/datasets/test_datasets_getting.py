"""A benchmark from a server on this machine: whole and checked under its name, or not there."""

import errno
import hashlib
import io
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

from placefield.errors import SourceError
from placefield_tools.datasets import getting
from placefield_tools.datasets.benchmarks import Benchmark, BenchmarkStudy, BenchmarkTraverse, File
from placefield_tools.datasets.checking import check
from placefield_tools.datasets.getting import get

FRAME = b"frame" * 1000


def ignore(number: int, there: int, total: int | None) -> None:
    pass


def zipped(content: dict[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with ZipFile(packed, "w") as archive:
        for name, data in content.items():
            archive.writestr(name, data)
    return packed.getvalue()


ARCHIVE = zipped({"day/1.jpg": FRAME, "day/2.jpg": FRAME, "night/1.jpg": FRAME})


def benchmark_at(url: str, **changes: Any) -> Benchmark:
    known: dict[str, Any] = {
        "name": "walk",
        "title": "Walk",
        "about": "a walk",
        "citation": "nobody",
        "licence": "CC0-1.0",
        "page": "https://example.org",
        "size": "small",
        "tolerance": "1 frame",
        "truth": "numbers",
        "traverses": (
            BenchmarkTraverse(name="day", folder="day", frames=2),
            BenchmarkTraverse(name="night", folder="night"),
        ),
        "study": BenchmarkStudy(reference="day", query="night", tolerance=1),
        "files_at": f"{url}/",
        "files": (File(name="walk.zip"),),
    }
    return Benchmark.model_validate(known | changes)


def test_an_archive_becomes_the_benchmarks_folder_and_its_sum_is_kept(
    web: Any, tmp_path: Path
) -> None:
    web.content["/walk.zip"] = ARCHIVE
    folder = get(benchmark_at(web.url), tmp_path / "new", ignore)
    assert folder == tmp_path / "new" / "walk"
    assert check(benchmark_at(web.url), folder) == {"day": 2, "night": 1}
    kept = (tmp_path / "new" / "walk.sha256").read_text()
    assert kept == f"{hashlib.sha256(ARCHIVE).hexdigest()}  walk.zip\n"
    assert {entry.name for entry in folder.parent.iterdir()} == {"walk", "walk.sha256"}


def test_single_files_come_under_their_names_and_archives_into_theirs(
    web: Any, tmp_path: Path
) -> None:
    web.content |= {"/day/1.jpg": FRAME, "/day/2.jpg": b"2", "/n.zip": zipped({"1.jpg": b"3"})}
    files = (
        File(name="day/1.jpg", bytes=len(FRAME), sha256=hashlib.sha256(FRAME).hexdigest()),
        File(name="day/2.jpg"),
        File(name="n.zip", into="night"),
    )
    folder = get(benchmark_at(web.url, files=files), tmp_path, ignore)
    assert (folder / "day" / "1.jpg").read_bytes() == FRAME
    assert (folder / "night" / "1.jpg").read_bytes() == b"3"
    kept = (tmp_path / "walk.sha256").read_text()
    assert [line.split()[1] for line in kept.splitlines()] == ["day/2.jpg", "n.zip"]


def test_one_that_was_cut_off_is_not_there_and_goes_on(web: Any, tmp_path: Path) -> None:
    web.content |= {"/first.zip": ARCHIVE, "/walk.zip": zipped({"1.jpg": FRAME})}
    known = benchmark_at(
        web.url, files=(File(name="first.zip"), File(name="walk.zip", into="more"))
    )
    web.cuts = [len(ARCHIVE), 100, 0]
    with pytest.raises(SourceError, match="run the same command again"):
        get(known, tmp_path, ignore)
    assert not (tmp_path / "walk").exists()
    folder = get(known, tmp_path, ignore)
    assert (folder / "more" / "1.jpg").read_bytes() == FRAME
    assert web.sent == {path: len(body) for path, body in web.content.items()}


def test_a_file_that_is_not_what_is_published_is_refused_and_removed(
    web: Any, tmp_path: Path
) -> None:
    web.content["/walk.zip"] = ARCHIVE
    known = benchmark_at(web.url, files=(File(name="walk.zip", sha256="0" * 64),))
    with pytest.raises(
        SourceError, match=r"walk.zip: removed, its SHA-256 is \w+ and not 0+ as is"
    ):
        get(known, tmp_path, ignore)
    assert not (tmp_path / "walk").exists()
    assert not list(tmp_path.rglob("*.zip*.part"))


def test_a_file_that_is_not_what_it_was_the_first_time_is_refused(web: Any, tmp_path: Path) -> None:
    web.content["/walk.zip"] = ARCHIVE
    folder = get(benchmark_at(web.url), tmp_path, ignore)
    folder.rename(tmp_path / "old")
    web.content["/walk.zip"] = zipped({"day/1.jpg": b"another"})
    with pytest.raises(SourceError, match=r"as .*walk.sha256 says; remove that if you trust"):
        get(benchmark_at(web.url), tmp_path, ignore)
    assert not folder.exists()
    web.content["/walk.zip"] = ARCHIVE
    assert get(benchmark_at(web.url), tmp_path, ignore) == folder


def test_half_a_file_is_not_taken_for_what_it_is_to_be(web: Any, tmp_path: Path) -> None:
    web.content["/walk.zip"] = ARCHIVE
    web.knows_lengths, web.cuts = False, [len(ARCHIVE) // 2]
    with pytest.raises(SourceError, match=r"(/.*/walk.zip): is damaged .*; remove it") as reported:
        get(benchmark_at(web.url), tmp_path, ignore)
    assert not (tmp_path / "walk.sha256").exists()
    Path(str(reported.value).partition(":")[0]).unlink()
    get(benchmark_at(web.url), tmp_path, ignore)


def test_a_list_of_sums_that_is_none_is_reported(web: Any, tmp_path: Path) -> None:
    web.content["/walk.zip"] = ARCHIVE
    (tmp_path / "walk.sha256").write_bytes(b"\xff nonsense")
    with pytest.raises(SourceError, match=r"walk.sha256: is not a list of SHA-256 sums"):
        get(benchmark_at(web.url), tmp_path, ignore)


def test_a_matrix_of_right_places_becomes_a_table(web: Any, tmp_path: Path) -> None:
    right = np.zeros((5, 3), dtype=np.uint8)
    right[[0, 1, 4], 0] = right[2:, 2] = 1
    matrix = io.BytesIO()
    np.savez(matrix, GTsoft=right, GThard=right)
    web.content["/walk.zip"] = zipped({"GT.npz": matrix.getvalue(), "day/1.jpg": FRAME})
    folder = get(benchmark_at(web.url, truth_matrix="GT.npz"), tmp_path, ignore)
    assert (folder / "truth.csv").read_text() == "query,first,last\n0,0,1\n0,4,4\n2,2,4\n"


def test_a_matrix_that_is_none_is_reported(web: Any, tmp_path: Path) -> None:
    pickled = io.BytesIO()
    np.savez(pickled, GTsoft=np.array([{}], dtype=object))
    for content in (b"nonsense", pickled.getvalue()):
        web.content["/walk.zip"] = zipped({"GT.npz": content, "day/1.jpg": FRAME})
        with pytest.raises(SourceError, match=r"GT.npz: holds no matrix GTsoft"):
            get(benchmark_at(web.url, truth_matrix="GT.npz"), tmp_path / content[:1].hex(), ignore)


def test_what_is_to_be_got_by_hand_is_reported(tmp_path: Path) -> None:
    known = benchmark_at("", files=(), files_at=None, by_hand="ask the authors")
    with pytest.raises(SourceError, match=r"walk: ask the authors; put it in .*/walk"):
        get(known, tmp_path, ignore)


def test_what_is_there_is_left_alone(web: Any, tmp_path: Path) -> None:
    (tmp_path / "walk").mkdir()
    with pytest.raises(SourceError, match="exists already; 'placefield datasets check walk"):
        get(benchmark_at(web.url), tmp_path, ignore)
    assert web.ranges == []


def test_two_at_once_do_not_meet(web: Any, tmp_path: Path) -> None:
    web.content["/walk.zip"] = ARCHIVE

    def again(*_: object) -> None:
        with pytest.raises(SourceError, match="another process downloads it"):
            get(benchmark_at(web.url), tmp_path, ignore)

    get(benchmark_at(web.url), tmp_path, again)


def test_a_full_disk_is_reported_and_what_has_come_is_kept(
    web: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    web.content["/walk.zip"] = ARCHIVE

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(getting, "unpack", full)
        with pytest.raises(SourceError, match="the disk is full; free some space"):
            get(benchmark_at(web.url), tmp_path, ignore)
    assert not (tmp_path / "walk").exists()
    get(benchmark_at(web.url), tmp_path, ignore)
    assert web.sent["/walk.zip"] == len(ARCHIVE)
