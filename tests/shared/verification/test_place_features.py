"""A map's local features, and what their inliers say of one place and of two."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import MapError
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.verification.extracting import extract
from placefield.verification.learning import features_of_places
from placefield.verification.local_features import NO_FEATURES, LocalFeatures
from placefield.verification.place_features import NO_PAIRS, NO_RATIOS, PlaceFeatures
from placefield.verification.two_views import count_inliers
from placefield_tools.build.map_from_sources import build_from

PLACES = 40
LINE = np.arange(PLACES, dtype=np.int32)


@pytest.fixture(scope="module")
def views() -> list[LocalFeatures]:
    """A camera that pans along a wall of random dots; neighbours share most of their view."""
    rng = np.random.default_rng(0)
    wall = np.kron(rng.integers(0, 255, (40, 400)), np.ones((4, 4))).astype(np.uint8)
    return [extract(np.ascontiguousarray(wall[:, at : at + 200]), 150) for at in LINE * 30]


@pytest.fixture(scope="module")
def places(views: list[LocalFeatures]) -> PlaceFeatures:
    found = features_of_places(views, [], LINE, 0)
    assert found is not None
    return found


def test_each_place_keeps_its_own(views: list[LocalFeatures], places: PlaceFeatures) -> None:
    for place in (0, 17, PLACES - 1):
        np.testing.assert_array_equal(places.of(place).points, views[place].points)
        np.testing.assert_array_equal(places.of(place).descriptors, views[place].descriptors)
    assert places.most == max(len(view.points) for view in views)


def test_the_right_place_has_far_more_inliers_than_another(
    views: list[LocalFeatures], places: PlaceFeatures
) -> None:
    right, wrong = (count_inliers(places.of(place), views[21], 0) for place in (20, 5))
    assert right > 2 * wrong
    assert right == count_inliers(places.of(20), views[21], 0)
    assert abs(wrong - np.median(places.by_chance)) < 5


def test_inliers_by_chance_are_those_of_another_traverse_if_there_is_one(
    views: list[LocalFeatures],
) -> None:
    blank = [(place, NO_FEATURES) for place in range(PLACES)]
    learned = features_of_places(views, blank, LINE, 0)
    assert learned is not None
    assert not learned.by_chance.any()


def test_a_map_too_small_for_two_places_and_one_without_texture_have_none(
    views: list[LocalFeatures],
) -> None:
    assert features_of_places(views[:5], [], LINE[:5], 0) is None
    blank = [extract(np.full((60, 80), 9, np.uint8), 10)] * PLACES
    assert features_of_places(blank, [], LINE, 0) is None


def with_local_features(reference_dir: Path) -> Map:
    config = Config.model_validate(
        {
            "build": {"local_features": 60},
            "scales": {"channels": 1},
            "metric": {"kind": "identity"},
        }
    )
    return build_from([str(reference_dir)], config)


def test_a_map_keeps_them_on_disk_and_refuses_wrong_ones(
    reference_dir: Path, tmp_path: Path
) -> None:
    built = with_local_features(reference_dir)
    assert built.local_features is not None
    assert 0 < built.local_features.most <= 60
    save_map(built, tmp_path / "route.pfmap")
    opened = open_map(tmp_path / "route.pfmap").local_features
    assert opened is not None
    for name, array in vars(built.local_features).items():
        np.testing.assert_array_equal(getattr(opened, name), array)

    wrong: dict[str, NDArray[np.generic]] = {
        "ends": built.local_features.ends[::-1].copy(),
        "ratios": np.array([1.0, -1.0]),
        "by_chance": -1 - built.local_features.by_chance,
        "points": np.full_like(built.local_features.points, np.nan),
        "descriptors": built.local_features.descriptors[:, 1:],
    }
    for name, array in wrong.items():
        spoilt = replace(built.local_features, **{name: array})
        save_map(replace(built, local_features=spoilt), tmp_path / "spoilt.pfmap")
        with pytest.raises(MapError, match="local_features"):
            open_map(tmp_path / "spoilt.pfmap")


def test_descriptors_of_a_network_have_any_width_up_to_a_limit(
    reference_dir: Path, tmp_path: Path
) -> None:
    built = with_local_features(reference_dir)
    assert built.local_features is not None
    for width, is_refused in ((64, False), (512, False), (513, True), (0, True)):
        descriptors = np.zeros((len(built.local_features.points), width), np.uint8)
        onnx = np.arange(9, dtype=np.uint8)
        wide = replace(built.local_features, descriptors=descriptors, onnx=onnx)
        save_map(replace(built, local_features=wide), tmp_path / "wide.pfmap")
        if is_refused:
            with pytest.raises(MapError, match="no number, or more than 512"):
                open_map(tmp_path / "wide.pfmap")
        else:
            opened = open_map(tmp_path / "wide.pfmap").local_features
            assert opened is not None
            np.testing.assert_array_equal(opened.onnx, onnx)


def test_a_map_without_them_has_none(route_map: Map) -> None:
    assert route_map.local_features is None


def test_places_are_appended_and_dropped_with_their_own(
    views: list[LocalFeatures], places: PlaceFeatures
) -> None:
    grown = places.with_places(views[3:5])
    assert len(grown.ends) == PLACES + 2
    np.testing.assert_array_equal(grown.of(PLACES + 1).points, views[4].points)
    shrunk = grown.kept(np.array([2, PLACES]))
    np.testing.assert_array_equal(shrunk.of(0).descriptors, views[2].descriptors)
    np.testing.assert_array_equal(shrunk.of(1).descriptors, views[3].descriptors)
    np.testing.assert_array_equal(shrunk.by_chance, places.by_chance)


def test_a_place_without_any_may_stand_beside_descriptors_of_any_width(
    places: PlaceFeatures,
) -> None:
    narrow = replace(places, descriptors=places.descriptors[:, :64])
    grown = narrow.with_places([NO_FEATURES])
    assert grown.descriptors.shape == narrow.descriptors.shape
    assert len(grown.of(PLACES).points) == 0


def test_a_map_of_an_earlier_version_keeps_its_ratios(reference_dir: Path, tmp_path: Path) -> None:
    built = with_local_features(reference_dir)
    assert built.local_features is not None
    older = replace(built.local_features, ratios=np.array([0.5, 2.0]), by_chance=NO_PAIRS)
    save_map(replace(built, local_features=older), tmp_path / "older.pfmap")
    assert not (tmp_path / "older.pfmap" / "local_features" / "by_chance.npy").exists()
    opened = open_map(tmp_path / "older.pfmap").local_features
    assert opened is not None
    np.testing.assert_array_equal(opened.ratios, [0.5, 2])
    assert len(opened.by_chance) == 0

    nothing = replace(older, ratios=NO_RATIOS)
    save_map(replace(built, local_features=nothing), tmp_path / "nothing.pfmap")
    with pytest.raises(MapError, match="nothing was learned"):
        open_map(tmp_path / "nothing.pfmap")
