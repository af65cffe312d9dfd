import errno
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from placefield.errors import MapError
from placefield.maps.manifest import MANIFEST, SEAL, read_manifest
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.receiving import PartialMap, opened_if_there, receiving
from placefield.maps.store import save_map
from placefield.maps.transfer import CHUNK, Chunk, Offer, OwnMap


def content(folder: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "there" / "route.pfmap"


@pytest.fixture(scope="module")
def large(pristine: Path, tmp_path_factory: pytest.TempPathFactory, posed_map: Map) -> Path:
    """A map of which one file has several chunks; do not change it."""
    ends = posed_map.places.thumbnail_ends.copy()
    ends[-1] = 3 * CHUNK + 5
    pixels = np.random.default_rng(5).integers(0, 256, ends[-1], np.uint8)
    path = tmp_path_factory.mktemp("large") / "route.pfmap"
    places = replace(posed_map.places, thumbnails=pixels, thumbnail_ends=ends)
    save_map(replace(posed_map, places=places), path)
    return path


def send(own: OwnMap, partial: PartialMap, most: int | None = None) -> list[Chunk]:
    """Send what is missing, or so many chunks of it; return which."""
    sent: list[Chunk] = []
    offer = own.offer()
    partial.begin(offer)
    for chunk in partial.missing():
        if len(sent) == most:
            break
        partial.add(chunk, own.chunk(offer.digest, chunk.file, chunk.number))
        sent.append(chunk)
    return sent


def test_a_map_arrives_bit_for_bit_and_works(large: Path, target: Path) -> None:
    own = OwnMap(large)
    with receiving(target) as partial:
        assert len(send(own, partial)) == own.offer().chunks == partial.there
        assert not target.exists()
        arrived = partial.finish()
    assert content(target) == content(large)
    assert [path.name for path in target.parent.iterdir()] == ["route.pfmap"]
    assert arrived.places.count == open_map(target).places.count == 90


def test_what_has_arrived_is_not_asked_for_again(large: Path, target: Path) -> None:
    own, chunks = OwnMap(large), OwnMap(large).offer().chunks
    arrived = 0
    for most in (3, 2, 3, None):
        with receiving(target) as partial:
            arrived += len(send(own, partial, most))
            assert partial.there == arrived
    assert arrived == chunks
    with receiving(target) as partial:
        assert send(own, partial) == []
        partial.finish()
    assert content(target) == content(large)


@settings(max_examples=30)
@given(data=st.data())
def test_whatever_happened_to_what_had_arrived_the_map_is_whole(
    large: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    own, target = OwnMap(large), tmp_path_factory.mktemp("there") / "route.pfmap"
    with receiving(target) as partial:
        send(own, partial, data.draw(st.integers(1, own.offer().chunks)))
        file = data.draw(st.sampled_from([f for f in partial.folder.rglob("*") if f.is_file()]))
    whole = file.read_bytes()
    match data.draw(st.sampled_from(["cut", "grown", "flipped", "gone"])):
        case "cut":
            file.write_bytes(whole[: data.draw(st.integers(0, len(whole)))])
        case "grown":
            file.write_bytes(whole + b"x" * data.draw(st.sampled_from([1, CHUNK, 2 * CHUNK])))
        case "flipped" if whole:
            at = data.draw(st.integers(0, len(whole) - 1))
            file.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        case _:
            file.unlink()
    with receiving(target) as partial:
        send(own, partial)
        assert partial.there == own.offer().chunks
        partial.finish()
    assert content(target) == content(large)


def test_a_map_that_has_not_arrived_in_full_cannot_be_opened(large: Path, target: Path) -> None:
    own = OwnMap(large)
    for most in (1, *[4] * 4, None):
        with receiving(target) as partial:
            send(own, partial, most)
            with pytest.raises(MapError):
                open_map(partial.folder, channels=())
            with pytest.raises(MapError):
                read_manifest(partial.folder)
        assert not target.exists()


def test_another_map_than_the_one_that_began_to_arrive_begins_anew(
    large: Path, pristine: Path, target: Path
) -> None:
    with receiving(target) as partial:
        send(OwnMap(large), partial, 8)
    (partial.folder / "places" / "of_the_old_one.npy").write_bytes(b"x")
    with receiving(target) as partial:
        assert len(send(OwnMap(pristine), partial)) == OwnMap(pristine).offer().chunks
        partial.finish()
    assert content(target) == content(pristine)


def test_a_file_that_arrives_damaged_is_refused_and_not_kept(large: Path, target: Path) -> None:
    own = OwnMap(large)
    with receiving(target) as partial:
        partial.begin(own.offer())
        missing = partial.missing()
        chunk = next(missing)
        assert chunk.file == "features/mean.npy"
        partial.add(chunk, bytes(chunk.length))
        with pytest.raises(MapError, match=r"features/mean\.npy arrives with a wrong checksum"):
            next(missing)
        assert not (partial.folder / "features/mean.npy").exists()
        assert not (partial.folder / SEAL).exists()
    assert not target.exists()


def test_one_receives_at_a_time(large: Path, target: Path) -> None:
    with receiving(target) as first:
        send(OwnMap(large), first, 3)
        with pytest.raises(MapError, match="another process fetches it"), receiving(target):
            pass
        send(OwnMap(large), first)
        first.finish()
    assert content(target) == content(large)


def test_a_map_that_is_larger_than_the_disk_is_refused_before_it_is_asked_for(
    large: Path, target: Path
) -> None:
    offer = OwnMap(large).offer()
    huge = Offer(offer.written, dict.fromkeys(offer.sizes, 2**48 - 1))
    with (
        receiving(target) as partial,
        pytest.raises(MapError, match=r"MiB are still missing.* free some space"),
    ):
        partial.begin(huge)


def receive_on_a_disk_with_room_for_three(own: OwnMap, target: Path) -> None:
    with receiving(target) as partial:
        send(own, partial, 3)
        raise OSError(errno.ENOSPC, "no space")


def test_a_full_disk_is_one_line_and_what_has_arrived_stays(large: Path, target: Path) -> None:
    own = OwnMap(large)
    with pytest.raises(MapError) as refused:
        receive_on_a_disk_with_room_for_three(own, target)
    assert str(refused.value) == f"{target}: cannot be fetched: the disk is full; free some space"
    with receiving(target) as partial:
        partial.begin(own.offer())
        assert partial.there == 3


@pytest.mark.parametrize("linked", ["places", "places/stamps.npy"])
def test_a_link_in_what_has_arrived_is_not_written_through(
    large: Path, target: Path, tmp_path: Path, linked: str
) -> None:
    outside = tmp_path / "outside"
    (outside / "inner").mkdir(parents=True)
    (outside / "stamps.npy").write_bytes(b"mine")
    with receiving(target) as partial:
        send(OwnMap(large), partial, 1)
        link = partial.folder / linked
        link.parent.mkdir(exist_ok=True)
        link.symlink_to(outside if linked == "places" else outside / "stamps.npy")
    with receiving(target) as partial, pytest.raises(MapError, match="is a link"):
        send(OwnMap(large), partial)
    assert content(outside) == {"stamps.npy": b"mine"}


def test_a_map_that_is_there_is_opened_and_another_one_left_alone(
    large: Path, pristine: Path, target: Path
) -> None:
    assert opened_if_there(target, OwnMap(large).offer()) is None
    save_map(open_map(large), target)
    opened = opened_if_there(target, OwnMap(large).offer())
    assert opened is not None
    assert opened.places.count == 90
    with pytest.raises(MapError, match="not the offered map; remove it"):
        opened_if_there(target, OwnMap(pristine).offer())
    assert content(target) == content(large)


def test_nothing_is_left_where_nothing_was_offered(target: Path) -> None:
    with receiving(target):
        pass
    assert list(target.parent.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with (
        pytest.raises(MapError, match=r"cannot be fetched: Not a directory"),
        receiving(tmp_path / "file" / "route.pfmap"),
    ):
        pass
    assert MANIFEST not in {path.name for path in tmp_path.iterdir()}
