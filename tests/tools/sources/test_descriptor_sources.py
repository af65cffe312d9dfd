"""Descriptors of other programs, read from files as those programs write them."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.errors import FrameError, SourceError
from placefield.features.frames import Pose
from placefield_tools.sources import Parts, open_source
from placefield_tools.sources.drives import drives_of

VECTORS = np.random.default_rng(5).normal(size=(6, 4)).astype(np.float32)


def saved(path: Path, array: Any) -> str:
    np.save(path, array)
    return str(path)


def read(where: str, parts: Parts | None = None) -> list[NDArray[np.floating]]:
    with open_source(where, parts=parts or Parts()) as source:
        assert source.dimensions == 4
        frames = list(source)
        assert source.count == len(frames)
    return [frame.descriptor for frame in frames if frame.descriptor is not None]


@pytest.mark.parametrize(
    ("stored", "given"), [("<f2", "f2"), ("<f4", "f4"), (">f4", "f4"), ("<f8", "f4")]
)
def test_the_rows_of_a_file_are_its_frames(tmp_path: Path, stored: str, given: str) -> None:
    read_back = read(saved(tmp_path / "drive.npy", VECTORS.astype(stored)))
    assert {vector.dtype for vector in read_back} == {np.dtype(given)}
    np.testing.assert_array_equal(read_back, VECTORS.astype(stored).astype(given))


def test_start_stop_and_stride_choose_rows_which_keep_their_numbers(tmp_path: Path) -> None:
    where = saved(tmp_path / "drive.npy", VECTORS)
    with open_source(where, parts=Parts(start=1, stop=5, stride=2)) as source:
        frames = list(source)
    assert [(frame.index, frame.stamp_ns) for frame in frames] == [(1, 10**8), (3, 3 * 10**8)]
    assert [frame.name for frame in frames] == ["drive.npy#1", "drive.npy#3"]
    with pytest.raises(FrameError, match="a descriptor, where an image is needed"):
        frames[0].pixels()


@pytest.mark.parametrize("named", [{"features": VECTORS}, {"descriptors": VECTORS, "ids": [1]}])
def test_an_archive_has_one_array_or_a_named_one(
    tmp_path: Path, named: dict[str, NDArray[Any]]
) -> None:
    np.savez_compressed(tmp_path / "drive.npz", **named)
    np.testing.assert_array_equal(read(str(tmp_path / "drive.npz")), VECTORS)


def test_a_table_of_the_files_name_gives_stamps_and_poses(tmp_path: Path) -> None:
    where = saved(tmp_path / "drive.npy", VECTORS)
    rows = [f"not-there-{at}.jpg,{2 * at},{3 * at},0" for at in range(6)]
    (tmp_path / "drive.csv").write_text("\n".join(["file,stamp,x,y", *rows]))
    with open_source(where) as source:
        assert source.stamped
        assert source.span == (0, 10 * 10**9)
        frames = list(source)
    assert frames[2].stamp_ns == 4 * 10**9
    assert frames[2].pose == Pose(6.0, 0.0, 0.0)
    assert frames[2].odometry_m == 6.0
    (tmp_path / "drive.csv").write_text("stamp\n0\n1\n")
    with pytest.raises(SourceError, match=r"drive\.csv: has 2 rows, and drive\.npy has 6 desc"):
        open_source(where)


def test_two_files_of_one_drive_go_on_by_their_stamps(tmp_path: Path) -> None:
    for name, first in (("a", 0), ("b", 6)):
        saved(tmp_path / f"{name}.npy", VECTORS)
        stamps = [str(first + at) for at in range(6)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["stamp", *stamps]))
    names = [str(tmp_path / "a.npy"), str(tmp_path / "b.npy")]
    assert drives_of(names, Parts(), None) == [tuple(names)]


def test_a_folder_has_a_vector_per_frame_in_the_order_of_names_or_of_its_table(
    tmp_path: Path,
) -> None:
    for number, vector in enumerate(VECTORS):
        saved(tmp_path / f"{number + 5}.npy", vector)  # 5 to 10
    np.testing.assert_array_equal(read(str(tmp_path)), VECTORS)
    (tmp_path / "frames.csv").write_text("file,stamp\n9.npy,1\n5.npy,2\n")
    np.testing.assert_array_equal(read(str(tmp_path)), VECTORS[[4, 0]])
    (tmp_path / "inside").mkdir()
    saved(tmp_path / "inside" / "one.npy", VECTORS[2])
    (tmp_path / "frames.csv").write_text("file\ninside/one.npy\n9.npy\n5.npy\n")
    np.testing.assert_array_equal(read(str(tmp_path)), VECTORS[[2, 4, 0]])
    saved(tmp_path / "5.npy", VECTORS)
    with pytest.raises(SourceError, match=r"5\.npy: has 6 descriptors; a file that frames\.csv"):
        open_source(str(tmp_path))


def test_images_are_the_frames_of_a_folder_that_has_other_arrays_too(
    tmp_path: Path, reference_dir: Path
) -> None:
    (tmp_path / "images").symlink_to(reference_dir, target_is_directory=True)
    saved(tmp_path / "poses.npy", VECTORS)
    (tmp_path / "frames.csv").write_text("file\nimages/0001.jpg\nimages/0000.jpg\n")
    with open_source(str(tmp_path)) as source:
        assert source.dimensions is None
        assert [frame.image for frame in source] == [
            (reference_dir / name).read_bytes() for name in ("0001.jpg", "0000.jpg")
        ]


def test_a_folder_of_several_arrays_is_one_drive(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    saved(tmp_path / "part2.npy", VECTORS[:4])
    saved(tmp_path / "part10.npy", VECTORS[4:])
    np.testing.assert_array_equal(read(str(tmp_path)), VECTORS)
    assert "its files are one drive: part2.npy first" in caplog.text


def test_the_two_sides_of_an_evaluation_are_not_one_drive(tmp_path: Path) -> None:
    for side in ("database", "queries"):
        saved(tmp_path / f"{side}_descriptors.npy", VECTORS)
    with pytest.raises(SourceError, match=r"two drives; give database_descriptors\.npy and quer"):
        open_source(str(tmp_path))


def write_hloc(path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for number, vector in enumerate(VECTORS):
            side = "db" if number < 4 else "query"
            group = file.create_group(f"{side}/frame{number + 8}.jpg")  # 8 to 13
            group.create_dataset("global_descriptor", data=vector.astype(np.float16))
            group.create_dataset("image_size", data=np.array([640, 480]))


def test_the_images_of_hloc_are_frames_in_natural_order(tmp_path: Path) -> None:
    write_hloc(tmp_path / "global-feats.h5")
    halves = VECTORS.astype(np.float16)
    np.testing.assert_array_equal(read(str(tmp_path / "global-feats.h5")), halves)
    np.testing.assert_array_equal(read(str(tmp_path / "global-feats.h5" / "query")), halves[4:])
    with pytest.raises(SourceError, match="has no group 'day'; it has db, query"):
        open_source(str(tmp_path / "global-feats.h5" / "day"))
    (tmp_path / "cut.h5").write_bytes((tmp_path / "global-feats.h5").read_bytes()[:900])
    with pytest.raises(SourceError, match=r"cut\.h5: no HDF5 file, or damaged"):
        open_source(str(tmp_path / "cut.h5"))


def test_a_descriptor_that_is_not_finite_is_a_fault_of_its_frame(tmp_path: Path) -> None:
    vectors = VECTORS.astype(np.float64)
    vectors[1, 2], vectors[3, 0] = np.nan, 1e300
    with open_source(saved(tmp_path / "drive.npy", vectors)) as source:
        frames = list(source)
    assert [frame.index for frame in frames if frame.fault] == [1, 3]
    with pytest.raises(FrameError, match="the descriptor is not finite"):
        frames[3].pixels()


def write_pickle(path: Path) -> None:
    path.write_bytes(pickle.dumps(VECTORS))


def cut_off(path: Path) -> None:
    np.save(path, VECTORS)
    path.write_bytes(path.read_bytes()[:-8])


BAD: list[tuple[str, Callable[[Path], object], str]] = [
    ("a.npy", lambda path: np.save(path, VECTORS[0]), r"has shape \(4,\); give \(N, D\)"),
    ("a.npy", lambda path: np.save(path, VECTORS[None]), r"has shape \(1, 6, 4\); give"),
    ("a.npy", lambda path: np.save(path, VECTORS[:0]), "holds no descriptor"),
    ("a.npy", lambda path: np.save(path, VECTORS[:, :1]), "descriptors of 1 dimensions"),
    ("a.npy", lambda path: np.save(path, VECTORS.astype(np.uint8)), "is of uint8; give float16"),
    ("a.npy", lambda path: np.save(path, VECTORS.astype(object)), "no array of numbers"),
    ("a.npy", cut_off, "no array of numbers, or cut off"),
    (
        "a.npz",
        lambda path: path.write_bytes(b"PK\3\4" + bytes(60)),
        "no array of numbers, or cut off",
    ),
    ("a.npz", lambda path: np.savez(path, x=VECTORS, y=VECTORS), "holds x, y; name the array"),
    ("a.pickle", write_pickle, "pickles are not read, because they can run code"),
]


@pytest.mark.parametrize(("name", "write", "reason"), BAD)
def test_a_file_that_has_no_descriptors_is_one_line(
    tmp_path: Path, name: str, write: Callable[[Path], object], reason: str
) -> None:
    write(tmp_path / name)
    with pytest.raises(SourceError, match=reason) as refused:
        open_source(str(tmp_path / name))
    assert "\n" not in str(refused.value)
    assert name in str(refused.value)


@pytest.mark.parametrize("other", [VECTORS[:, :3], None], ids=["another dimension", "images"])
def test_parts_of_one_drive_are_alike(
    tmp_path: Path, reference_dir: Path, other: NDArray[np.float32] | None
) -> None:
    second = str(reference_dir) if other is None else saved(tmp_path / "b.npy", other)
    with pytest.raises(SourceError, match="its parts are not alike; give images, or descriptors"):
        open_source([saved(tmp_path / "a.npy", VECTORS), second])
    if other is not None:
        saved(tmp_path / "b.npy", other)
        with pytest.raises(SourceError, match=r"b\.npy: descriptors of 3 dimensions, and those"):
            open_source(str(tmp_path))
