import threading
from collections import Counter
from hashlib import sha256
from pathlib import Path
from shutil import copytree

import pytest

from placefield.bus.maps import MapKeys, OfferMessage
from placefield.config import Config
from placefield.errors import ConfigError, MessageError
from placefield.maps.manifest import MANIFEST, read_manifest
from placefield.maps.transfer import OwnMap
from placefield_services.mapserver import MapAnswers, run_mapserver

KEYS = MapKeys("route")
STAMPS = "places/stamps.npy"


@pytest.fixture
def counts() -> Counter[str]:
    return Counter()


@pytest.fixture
def answers(map_path: Path, counts: Counter[str]) -> MapAnswers:
    return MapAnswers(OwnMap(map_path), "12ab", [counts])


def test_the_manifest_comes_with_the_server_and_the_sizes_of_the_files(
    answers: MapAnswers, map_path: Path, counts: Counter[str]
) -> None:
    ((written, about),) = answers.offer(KEYS.manifest, b"")
    assert written == (map_path / MANIFEST).read_bytes()
    offer = OfferMessage.decode(about)
    assert offer.server == "12ab"
    files = read_manifest(map_path).files
    assert offer.sizes == {name: (map_path / name).stat().st_size for name in files}
    assert counts == {"offers": 1}


def test_a_chunk_comes_with_its_digest(
    answers: MapAnswers, map_path: Path, counts: Counter[str]
) -> None:
    digest = OwnMap(map_path).offer().digest
    ((data, checksum),) = answers.chunk(KEYS.chunk("12ab", digest, STAMPS, 0), b"")
    assert data == (map_path / STAMPS).read_bytes()
    assert checksum == sha256(data).hexdigest().encode()
    assert counts == {"chunks": 1}


def test_a_query_for_anything_but_a_chunk_is_refused_and_counted(
    answers: MapAnswers, map_path: Path, counts: Counter[str]
) -> None:
    digest = OwnMap(map_path).offer().digest
    asked = [
        KEYS.chunk("12ab", "0" * 64, STAMPS, 0),
        KEYS.chunk("12ab", digest, STAMPS, 1),
        KEYS.chunk("12ab", digest, STAMPS, 10**12 - 1),
        KEYS.chunk("12ab", digest, MANIFEST, 0),
        KEYS.chunk("12ab", digest, "../query/0000.jpg", 0),
        KEYS.chunk("12ab", digest, "/etc/passwd", 0),
        KEYS.chunk("12ab", digest, "places/\0.npy", 0),
        KEYS.chunks("12ab"),
        "",
    ]
    for number, key in enumerate(asked):
        with pytest.raises(MessageError):
            answers.chunk(key, b"")
        assert counts == {"refused": number + 1}


def test_two_maps_of_one_name_are_not_served(map_path: Path, tmp_path: Path) -> None:
    other = copytree(map_path, tmp_path / map_path.name)
    with pytest.raises(ConfigError, match="give each name once"):
        run_mapserver([map_path, other], Config(), threading.Event())
