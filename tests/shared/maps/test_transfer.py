import json
import os
import shutil
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.errors import MapError
from placefield.maps.manifest import LONGEST_MANIFEST, MANIFEST, read_manifest
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield.maps.transfer import (
    CHUNK,
    Offer,
    OwnMap,
    chunk_count,
    chunks_of,
    digest_of,
    file_in,
    name_of,
)

LEADS_OUT = [
    "../secret.npy",
    "places/../../secret.npy",
    "places/./stamps.npy",
    "/etc/secret.npy",
    "places//stamps.npy",
    "..\\secret.npy",
    "places/stamps.npy\n",
    "places/stamps\0.npy",
    "places/stamps.npy/",
    "manifest.json",
    "places/stamps.py",
    "stamps.npy",
    "",
    "a/" * 9 + "b.npy",
    "a/" + "b" * 65 + ".npy",
]


@given(st.integers(1, 20 * CHUNK), st.integers(0, 20))
def test_chunks_are_of_a_file_each_byte_once_and_in_order(size: int, start: int) -> None:
    chunks = list(chunks_of("a/b.npy", size, start))
    assert len(chunks) == max(0, chunk_count(size) - start)
    at = start * CHUNK
    for chunk in chunks:
        assert chunk.file == "a/b.npy"
        assert chunk.number * CHUNK == at
        assert 0 < chunk.length <= CHUNK
        at += chunk.length
    assert at == size or at == start * CHUNK > size - CHUNK


def test_every_file_of_a_map_may_travel(saved: Path) -> None:
    files = read_manifest(saved).files
    assert {saved / name for name in files} == {file_in(saved, name) for name in files}
    assert {str(file.relative_to(saved)) for file in saved.rglob("*.npy")} == set(files)


@pytest.mark.parametrize("name", LEADS_OUT, ids=repr)
def test_no_name_leads_out_of_a_map(saved: Path, name: str) -> None:
    with pytest.raises(MapError, match="no file of a map has such a name") as refused:
        file_in(saved, name)
    assert "\n" not in str(refused.value)


_PARTS = st.lists(st.sampled_from(["..", ".", "", "/", "a", "places", "b.npy", "~", "\\", "%2e"]))


@given(st.one_of(st.text(), _PARTS.map("/".join), _PARTS.map("".join)), st.booleans())
def test_whatever_the_name_it_is_refused_or_lies_in_the_folder(name: str, is_array: bool) -> None:
    folder = Path("/maps/route.pfmap")
    with suppress(MapError):
        file = file_in(folder, name + ".npy" * is_array)
        assert file.resolve().is_relative_to(folder)
        assert file != folder


@pytest.mark.parametrize("linked", ["places/stamps.npy", "places"])
def test_a_link_is_not_followed(saved: Path, tmp_path: Path, linked: str) -> None:
    moved = (saved / linked).rename(tmp_path / "elsewhere")
    (saved / linked).symlink_to(moved)
    with pytest.raises(MapError, match="is a link"):
        file_in(saved, "places/stamps.npy")
    with pytest.raises(MapError, match="is a link"):
        OwnMap(saved)


def test_a_map_is_offered_with_the_sizes_of_its_files_and_given_in_chunks(saved: Path) -> None:
    own = OwnMap(saved)
    offer = own.offer()
    offer.check()
    assert own.name == "route"
    assert offer.written == (saved / MANIFEST).read_bytes()
    assert offer.digest == digest_of(offer.written)
    for name, size in offer.sizes.items():
        data = b"".join(own.chunk(offer.digest, *of) for of in _file_and_number(name, size))
        assert data == (saved / name).read_bytes()


def _file_and_number(name: str, size: int) -> list[tuple[str, int]]:
    return [(chunk.file, chunk.number) for chunk in chunks_of(name, size)]


def test_a_file_of_several_chunks_is_given_chunk_by_chunk(saved: Path) -> None:
    own = OwnMap(saved)
    content = bytes(range(256)) * (2 * CHUNK // 256) + b"end"
    (saved / "places/stamps.npy").write_bytes(content)
    digest = own.offer().digest
    chunks = [own.chunk(digest, "places/stamps.npy", number) for number in range(3)]
    assert [len(chunk) for chunk in chunks] == [CHUNK, CHUNK, 3]
    assert b"".join(chunks) == content
    with pytest.raises(MapError, match="has no chunk 3"):
        own.chunk(digest, "places/stamps.npy", 3)


@pytest.mark.parametrize("name", [*LEADS_OUT, "places/other.npy"], ids=repr)
def test_only_files_that_the_manifest_lists_are_given(saved: Path, name: str) -> None:
    own = OwnMap(saved)
    for secret in (saved / "../secret.npy", saved / "stamps.npy", saved / "places/other.npy"):
        secret.write_bytes(b"secret")
    with pytest.raises(MapError, match="this map has no file"):
        own.chunk(own.offer().digest, name, 0)


def test_a_fifo_in_a_map_does_not_stop_the_one_who_serves_it(saved: Path) -> None:
    (saved / "places/stamps.npy").unlink()
    os.mkfifo(saved / "places/stamps.npy")
    with pytest.raises(MapError, match="no file"):
        OwnMap(saved)


def test_another_map_in_the_same_place_is_another_offer(saved: Path, small_map: Map) -> None:
    own = OwnMap(saved)
    before = own.offer()
    save_map(small_map, saved)
    assert own.offer().digest != before.digest
    with pytest.raises(MapError, match="not the requested map"):
        own.chunk(before.digest, "places/stamps.npy", 0)
    shutil.rmtree(saved)
    with pytest.raises(MapError, match="no map there"):
        own.offer()
    with pytest.raises(MapError, match="the map is gone"):
        own.chunk(before.digest, "places/stamps.npy", 0)


def test_a_map_whose_manifest_is_damaged_is_not_offered(saved: Path) -> None:
    (saved / MANIFEST).write_bytes((saved / MANIFEST).read_bytes() + b" ")
    with pytest.raises(MapError, match="damaged"):
        OwnMap(saved)


def test_a_map_is_named_by_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "a route.v2.pfmap"
    folder.mkdir()
    monkeypatch.chdir(folder)
    assert name_of(folder) == name_of(Path()) == "a route.v2"
    with pytest.raises(MapError, match="ends in"):
        name_of(Path(".pfmap"))


def test_an_offer_that_no_honest_host_makes_is_refused(saved: Path) -> None:
    offer = OwnMap(saved).offer()
    sizes = dict(offer.sizes)
    name = next(iter(sizes))
    hostile = {
        "no JSON": Offer(b"{", sizes),
        "too long": Offer(offer.written + b" " * LONGEST_MANIFEST, sizes),
        "fewer files": Offer(offer.written, {name: 1}),
        "more files": Offer(offer.written, sizes | {"places/more.npy": 1}),
        "an empty file": Offer(offer.written, sizes | {name: 0}),
        "less than nothing": Offer(offer.written, sizes | {name: -CHUNK}),
    }
    for bad in LEADS_OUT[:-2]:
        written = offer.written.replace(name.encode(), _json(bad))
        hostile[bad] = Offer(written, {bad if of == name else of: sizes[of] for of in sizes})
    for what, bad_offer in hostile.items():
        with pytest.raises(MapError) as refused:
            bad_offer.check()
        assert "\n" not in str(refused.value), what


def _json(text: str) -> bytes:
    return json.dumps(text)[1:-1].encode()
