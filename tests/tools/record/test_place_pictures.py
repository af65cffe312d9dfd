"""The image of each matched place, beside what a recorder writes anyway."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from shutil import copytree, rmtree

import numpy as np
import pytest
from made_matches import KNOWN, SMOOTHED, Written, stream_of

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.features.images import decode
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_tools.record.place_pictures import PlacePictures, with_places
from placefield_tools.record.recorder import Recorder


def match_of(placemap: Map, place: int) -> MatchMessage:
    return MatchMessage(map=placemap.digest, place=place, score=1.0)


def is_grey(jpeg: bytes) -> bool:
    return bool(np.ptp(decode(jpeg)) == 0)


def test_each_match_at_once_is_followed_by_the_image_of_its_place(
    map_path: Path, route_map: Map
) -> None:
    matches: list[Written] = []
    places: list[tuple[Header, bytes]] = []

    @contextmanager
    def kept() -> Iterator[Recorder]:
        yield Recorder(
            lambda *match: matches.append(match), write_place=lambda *place: places.append(place)
        )

    smoothed = SMOOTHED.model_copy(update={"map": route_map.digest})
    written = stream_of([match_of(route_map, 7), smoothed, match_of(route_map, 9)])
    with with_places(kept(), PlacePictures(map_path)) as recorder:
        for header, match in written:
            recorder.write_match(header, match)
    assert matches == written
    assert [header.sequence for header, _ in places] == [0, 2]
    assert [jpeg for _, jpeg in places] == [route_map.places.thumbnail(place) for place in (7, 9)]


@pytest.mark.parametrize("place", [-1, 10**6])
def test_without_a_place_it_is_grey(map_path: Path, route_map: Map, place: int) -> None:
    assert is_grey(PlacePictures(map_path).of(match_of(route_map, place)))


def test_of_a_map_that_is_not_here_it_is_grey(map_path: Path) -> None:
    assert is_grey(PlacePictures(map_path).of(KNOWN))


def test_a_new_version_has_its_own_images_from_its_first_match_on(
    map_path: Path, route_map: Map, tmp_path: Path
) -> None:
    path = Path(copytree(map_path, tmp_path / "route.pfmap"))
    pictures = PlacePictures(path)
    places = route_map.places
    ends = places.thumbnail_ends
    shifted = replace(  # each place has the image of the next one
        places,
        thumbnails=places.thumbnails[ends[0] :],
        thumbnail_ends=np.append(ends[1:], ends[-1]) - ends[0],
    )
    rmtree(path)
    save_map(replace(route_map, places=shifted), path)
    version = open_map(path)
    old, new = route_map.places.thumbnail(5), route_map.places.thumbnail(6)
    assert pictures.of(match_of(route_map, 5)) == old
    assert pictures.of(match_of(version, 5)) == new
    rmtree(path)
    assert pictures.of(match_of(version, 5)) == new
    assert is_grey(pictures.of(match_of(route_map, 5)))
