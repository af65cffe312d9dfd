"""Maps that were made to do harm, checksums and all: refused in one line, with no crash or hang."""

import io
import json
import math
import os
import shutil
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.checksums import checksum_of
from placefield.maps.manifest import MANIFEST, SEAL, seal_of
from placefield.maps.map import Map
from placefield.maps.map_metrics import identity_metric
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.search.quantized import DESCRIPTOR_UNIT

LEAVES: st.SearchStrategy[Any] = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=10)
    | st.sampled_from([-1, 0, 1, 2**31, 2**63, 10**30, "", "../x", "/etc/passwd", "gist", "lmnn"])
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=6), inner, max_size=4)
    ),
    max_leaves=8,
)
DTYPES = ["float32", "float64", "int8", "uint8", "int16", "int32", "int64", ">i4", "U3", "S0", "V8"]


def open_or_refuse(path: Path) -> None:
    """Open; nothing but a MapError of one line may come of what is not right."""
    try:
        open_map(path)
    except MapError as error:
        line = str(error)
    else:
        return
    assert len(line.splitlines()) == 1
    assert str(path) in line
    assert len(line) < len(str(path)) + 400


def refusal(path: Path) -> str:
    with pytest.raises(MapError) as refused:
        open_map(path)
    assert len(str(refused.value).splitlines()) == 1
    return str(refused.value)


def seal(path: Path) -> None:
    """Give all files and the manifest the checksums that they should have."""
    manifest = json.loads((path / MANIFEST).read_text())
    for file in path.rglob("*.npy"):
        manifest["files"][str(file.relative_to(path))] = checksum_of(file)
    write_manifest(path, manifest)


def write_manifest(path: Path, manifest: Any) -> None:
    written = json.dumps(manifest).encode()
    (path / MANIFEST).write_bytes(written)
    (path / SEAL).write_bytes(seal_of(written))


@contextmanager
def restored(path: Path, *names: str) -> Iterator[None]:
    """Leave a map's manifest and some of its files as they were."""
    files = [path / name for name in (MANIFEST, SEAL, *names)]
    contents = [file.read_bytes() for file in files]
    try:
        yield
    finally:
        for file, content in zip(files, contents, strict=True):
            file.write_bytes(content)


def names_of(path: Path) -> list[str]:
    return sorted(str(file.relative_to(path)) for file in path.rglob("*") if file.is_file())


def arrays_of(path: Path) -> list[str]:
    return [name for name in names_of(path) if name.endswith(".npy")]


def npy(descr: str, shape: object, data: bytes = b"") -> bytes:
    """Return an array's file whose header says whatever it is told to."""
    header = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    header += b" " * (63 - (len(header) + 10) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + data


@settings(max_examples=50)
@given(data=st.data())
def test_a_cut_lengthened_or_flipped_file_is_refused_or_fits(
    pristine: Path, data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(names_of(pristine)))
    with restored(pristine, name):
        content = bytearray((pristine / name).read_bytes())
        for _ in range(data.draw(st.integers(1, 3))):
            at = data.draw(st.integers(0, len(content)))
            match data.draw(st.sampled_from(["cut", "drop", "add", "flip"])):
                case "cut":
                    del content[at:]
                case "drop":
                    del content[at : at + data.draw(st.integers(1, 100))]
                case "add":
                    content[at:at] = data.draw(st.binary(max_size=40))
                case "flip" if at < len(content):
                    content[at] ^= 1 << data.draw(st.integers(0, 7))
        (pristine / name).write_bytes(content)
        open_or_refuse(pristine)
        if name.endswith(".npy"):
            seal(pristine)
            open_or_refuse(pristine)


@settings(max_examples=50)
@given(data=st.data())
def test_an_array_of_any_dtype_and_shape_is_refused_or_fits(
    pristine: Path, data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(arrays_of(pristine)))
    with restored(pristine, name):
        shape = data.draw(st.lists(st.integers(-1, 4) | st.sampled_from([90, 2**40]), max_size=4))
        descr = data.draw(st.sampled_from([*DTYPES, "O", "|O8", "nonsense", "M8[ns]"]))
        content = npy(descr, tuple(shape), data.draw(st.binary(max_size=200)))
        (pristine / name).write_bytes(content)
        seal(pristine)
        open_or_refuse(pristine)


@settings(max_examples=20)
@given(data=st.data())
def test_files_that_have_changed_places_are_refused_or_fit(
    pristine: Path, data: st.DataObject
) -> None:
    one, other = data.draw(st.tuples(*2 * [st.sampled_from(arrays_of(pristine))]))
    with restored(pristine, one, other):
        contents = (pristine / one).read_bytes(), (pristine / other).read_bytes()
        (pristine / other).write_bytes(contents[0])
        (pristine / one).write_bytes(contents[1])
        open_or_refuse(pristine)
        seal(pristine)
        open_or_refuse(pristine)


@settings(max_examples=80)
@given(data=st.data())
def test_a_sealed_manifest_of_other_values_is_refused_or_fits(
    pristine: Path, data: st.DataObject
) -> None:
    with restored(pristine):
        manifest = json.loads((pristine / MANIFEST).read_text())
        table = manifest
        key = data.draw(st.sampled_from(sorted(table)))
        while isinstance(table[key], dict) and table[key] and data.draw(st.booleans()):
            table = table[key]
            key = data.draw(st.sampled_from(sorted(table)))
        table[key] = data.draw(VALUES)
        write_manifest(pristine, manifest)
        open_or_refuse(pristine)


ENORMOUS: dict[str, bytes] = {
    "rows": npy("<f4", (10**12, 300)),
    "rows times columns": npy("<f4", (2**40, 2**40)),
    "more than an address": npy("<f4", (10**30,)),
    "a width": npy("V2147483647", (2**33,)),
    "axes": npy("<f4", (1,) * 70),
    "a negative": npy("<f4", (-1,)),
    "a truth": npy("<f4", (True,)),
    "a header": b"\x93NUMPY\x02\x00\xff\xff\xff\x7f{",
    "brackets": npy("<f4", "(" * 5000 + ")" * 5000),
    "no python": npy("<f4", "__import__('os').getpid(),"),
    "nothing": b"",
    "a pickle": b"\x80\x04N.",
    "an archive": b"PK\x03\x04",
}


@pytest.mark.parametrize("content", ENORMOUS.values(), ids=ENORMOUS.keys())
@pytest.mark.parametrize("name", ["features/mean", "metrics/0/places", "channels/0/scales"])
def test_an_array_that_declares_what_it_has_not_is_refused_and_takes_no_memory(
    saved: Path, name: str, content: bytes
) -> None:
    (saved / f"{name}.npy").write_bytes(content)
    seal(saved)
    tracemalloc.start()
    try:
        assert str(saved / f"{name}.npy") in refusal(saved)
        assert tracemalloc.get_traced_memory()[1] < 8 * 2**20
    finally:
        tracemalloc.stop()


TB = 2**40


def sparse(descr: str, shape: tuple[int, ...]) -> Callable[[Path], None]:
    """Return what writes an array that is all there, and takes no room on the disk."""

    def write(file: Path) -> None:
        header = npy(descr, shape)
        file.write_bytes(header)
        size = len(header) + math.prod(shape) * np.dtype(descr).itemsize
        os.truncate(file, size)

    return write


def longer(file: Path) -> None:
    os.truncate(file, TB)


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("features/mean", longer),
        ("features/mean", sparse("<f4", (TB // 4,))),
        ("features/components", sparse("<f4", (TB // 4, 1))),
        ("places/stamps", sparse("<i8", (TB // 8,))),
        ("places/thumbnails", longer),
        ("places/thumbnails", sparse("|u1", (TB,))),
        ("channels/0/segments", sparse("<i4", (TB // 8, 2))),
        ("metrics/0/places", sparse("<i2", (90, TB // 180))),
    ],
)
def test_a_file_of_a_terabyte_is_refused_before_it_is_read(
    saved: Path, name: str, write: Callable[[Path], None]
) -> None:
    write(saved / f"{name}.npy")
    assert str(saved / f"{name}.npy") in refusal(saved)


@pytest.mark.timeout(20)
@pytest.mark.parametrize("name", [MANIFEST, SEAL])
def test_a_manifest_of_a_terabyte_is_refused_before_it_is_read(saved: Path, name: str) -> None:
    os.truncate(saved / name, TB)
    assert f"{saved / name}: more than" in refusal(saved)


@pytest.mark.parametrize("places", [10**7 + 1, 10**15])
def test_a_map_of_more_places_than_any_is_refused(saved: Path, places: int) -> None:
    manifest = json.loads((saved / MANIFEST).read_text())
    write_manifest(saved, manifest | {"places": places})
    assert f"{saved / MANIFEST}: places: " in refusal(saved)


def out_of_the_map(saved: Path, file: Path) -> None:
    shutil.move(file, saved.parent / file.name)
    file.symlink_to(saved.parent / file.name)


def out_by_its_folder(saved: Path, file: Path) -> None:
    shutil.move(file.parent, saved.parent / "elsewhere")
    file.parent.symlink_to(saved.parent / "elsewhere")


def around_in_circles(saved: Path, file: Path) -> None:
    file.unlink()
    file.symlink_to(file.name)


def to_a_device(saved: Path, file: Path) -> None:
    file.unlink()
    file.symlink_to("/dev/zero")


def a_pipe(saved: Path, file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


DETOURS: list[Callable[[Path, Path], None]] = [
    out_of_the_map,
    out_by_its_folder,
    around_in_circles,
    to_a_device,
    a_pipe,
]


@pytest.mark.timeout(20)
@pytest.mark.parametrize("detour", DETOURS)
def test_an_array_that_is_no_file_of_the_map_is_refused(
    saved: Path, detour: Callable[[Path, Path], None]
) -> None:
    file = saved / "metrics" / "0" / "places.npy"
    detour(saved, file)
    assert f"{file.parent}/" in refusal(saved)


@pytest.mark.timeout(20)
@pytest.mark.parametrize("name", [MANIFEST, SEAL])
@pytest.mark.parametrize("detour", [out_of_the_map, around_in_circles, to_a_device, a_pipe])
def test_a_manifest_that_is_no_file_of_the_map_is_refused(
    saved: Path, name: str, detour: Callable[[Path, Path], None]
) -> None:
    detour(saved, saved / name)
    assert str(saved) in refusal(saved)


@pytest.mark.parametrize(
    "written",
    [b"[" * 100_000, b'{"files": ' * 50_000, b"9" * 2**20, b"\xff\xfe", b"null", b'{"a\\n": 1}'],
    ids=["brackets", "mappings", "digits", "no text", "null", "newline"],
)
def test_a_manifest_that_is_made_to_hurt_is_refused(saved: Path, written: bytes) -> None:
    (saved / MANIFEST).write_bytes(written)
    (saved / SEAL).write_bytes(seal_of(written))
    open_or_refuse(saved)
    assert str(saved / MANIFEST) in refusal(saved)


def test_what_the_manifest_lists_besides_is_never_read(saved: Path) -> None:
    manifest = json.loads((saved / MANIFEST).read_text())
    os.mkfifo(saved / "pipe")
    manifest["files"] |= {"pipe": "0" * 64, "../../etc/passwd": "0" * 64, "/dev/zero": "0" * 64}
    write_manifest(saved, manifest)
    open_map(saved)


def test_an_array_that_lies_in_fortran_order_is_the_same(saved: Path) -> None:
    file = saved / "metrics" / "0" / "projection.npy"
    whole = np.load(file)
    written = io.BytesIO()
    np.save(written, np.asfortranarray(whole))
    file.write_bytes(written.getvalue())
    seal(saved)
    np.testing.assert_array_equal(open_map(saved).metrics[0].projection, whole)


def test_places_that_are_the_same_as_later_ones_or_none_are_refused(saved: Path) -> None:
    file = saved / "places" / "same.npy"
    known = np.load(file)
    for at, wrong in ((0, 1), (5, -1), (5, 6), (5, 2**31 - 1), (5, -(2**31))):
        changed = known.copy()
        changed[at] = wrong
        np.save(file, changed)
        seal(saved)
        assert f"{file}: " in refusal(saved)
    chain = known.copy()
    chain[50], chain[80] = 20, 50
    for other in (chain, known[:-1], known.astype(np.int64), known.astype(np.float32)):
        np.save(file, other)
        seal(saved)
        assert f"{file}: " in refusal(saved)
    chain[80] = 20
    np.save(file, chain)
    seal(saved)
    assert open_map(saved).places.same.tolist() == chain.tolist()


def test_metres_travelled_that_are_no_way_along_the_places_are_refused(saved: Path) -> None:
    file = saved / "places" / "travelled.npy"
    known = np.load(file)
    for wrong in (known[::-1], known[1:], known[:1], known * np.nan, known + np.inf):
        np.save(file, np.ascontiguousarray(wrong))
        seal(saved)
        assert f"{file}: " in refusal(saved)
    for right in (known, known[:0], known * 0):
        np.save(file, right)
        seal(saved)
        open_map(saved)


@pytest.mark.parametrize(
    ("file", "array", "complaint"),
    [
        ("metrics/0/coarse/spread.npy", np.eye(5), "does not fit the other files"),
        ("metrics/0/steps.npy", None, "not all is finite"),
    ],
)
def test_a_part_of_a_metric_that_would_fail_at_the_first_frame_is_refused(
    small_map: Map, tmp_path: Path, file: str, array: NDArray[np.float64] | None, complaint: str
) -> None:
    path = save_coarse(small_map, tmp_path)
    np.save(path / file, np.full_like(np.load(path / file), np.nan) if array is None else array)
    seal(path)
    assert complaint in refusal(path)


def save_coarse(small_map: Map, folder: Path) -> Path:
    """Save the map with an index."""
    path = folder / "coarse.pfmap"
    codes = small_map.metrics[0].places
    metric = identity_metric((codes * DESCRIPTOR_UNIT).astype(np.float32), coarse=True)
    channels = tuple(replace(channel, metric=metric) for channel in small_map.channels)
    save_map(replace(small_map, channels=channels, identity=metric), path)
    open_map(path)
    return path


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("ends", lambda known: known[::-1]),
        ("ends", lambda known: known + 1),
        ("ends", lambda known: known - known[0] - 1),
        ("places", lambda known: known + 1),
        ("places", lambda known: known - 1),
        ("codes", lambda known: known[1:]),
        ("centroids", lambda known: known[:, 1:]),
    ],
)
def test_lists_that_name_rows_or_places_that_are_not_there_are_refused(
    small_map: Map, tmp_path: Path, name: str, change: Callable[[NDArray[Any]], NDArray[Any]]
) -> None:
    path = save_coarse(small_map, tmp_path)
    file = path / "metrics" / "0" / "coarse" / "lists" / f"{name}.npy"
    np.save(file, np.ascontiguousarray(change(np.load(file))))
    seal(path)
    assert f"{file}: " in refusal(path)


def test_names_of_a_map_are_printed_without_control_codes(saved: Path) -> None:
    manifest = json.loads((saved / MANIFEST).read_text())
    count = manifest["places"]
    manifest["traverses"][0]["name"] = "a\x1b[2J\nb"
    manifest["routes"] = [{"name": "\x07é", "places": 1}, {"name": "b", "places": count - 1}]
    write_manifest(saved, manifest)
    opened = open_map(saved)
    assert opened.graph.names == (r"\x07é", "b")
    record = opened.traverses[0]
    assert record.name == r"a\x1b[2J\nb"
    assert record.is_named("a\x1b[2J\nb/")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "changes", [{"traverses": []}, {"routes": [{"name": "a", "places": 2**63}] * 3}]
)
def test_a_manifest_of_no_drive_or_of_endless_routes_is_refused(
    saved: Path, changes: dict[str, Any]
) -> None:
    manifest = json.loads((saved / MANIFEST).read_text())
    write_manifest(saved, manifest | changes)
    assert next(iter(changes)) in refusal(saved)
