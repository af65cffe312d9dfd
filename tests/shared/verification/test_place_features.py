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
from placefield.verification.place_features import PlaceFeatures
from placefield.verification.verifying import verify
from placefield_tools.build.map_from_sources import build_from

PLACES = 40
LINE = np.arange(PLACES, dtype=np.int32)
WHOLE = [(0, PLACES)]


@pytest.fixture(scope="module")
def views() -> list[LocalFeatures]:
    """A camera that pans along a wall of random dots; neighbours share most of their view."""
    rng = np.random.default_rng(0)
    wall = np.kron(rng.integers(0, 255, (40, 400)), np.ones((4, 4))).astype(np.uint8)
    return [extract(np.ascontiguousarray(wall[:, at : at + 200]), 150) for at in LINE * 30]


@pytest.fixture(scope="module")
def places(views: list[LocalFeatures]) -> PlaceFeatures:
    found = features_of_places(views, [], LINE, WHOLE, 0)
    assert found is not None
    return found


def test_each_place_keeps_its_own(views: list[LocalFeatures], places: PlaceFeatures) -> None:
    for place in (0, 17, PLACES - 1):
        np.testing.assert_array_equal(places.of(place).points, views[place].points)
        np.testing.assert_array_equal(places.of(place).descriptors, views[place].descriptors)
    assert places.most == max(len(view.points) for view in views)


def test_the_right_place_raises_the_probability_and_another_lowers_it_without_silencing_it(
    views: list[LocalFeatures], places: PlaceFeatures
) -> None:
    right = verify(places, 20, 0.9, views[21], 0)
    wrong = verify(places, 5, 0.9, views[21], 0)
    assert right.inliers > 2 * wrong.inliers
    assert right.probability > 0.99
    assert 0 < wrong.probability < 0.9
    assert right == verify(places, 20, 0.9, views[21], 0)


def test_views_of_another_traverse_are_believed_as_they_are(views: list[LocalFeatures]) -> None:
    # another traverse in whose light no right pair has more inliers than a wrong one
    strange = [(place, views[(place + 20) % PLACES]) for place in range(PLACES)]
    learned = features_of_places(views, strange, LINE, WHOLE, 0)
    assert learned is not None
    assert verify(learned, 20, 0.9, views[20], 0).ratio < 5


def test_no_pair_of_one_place_is_of_two_routes(views: list[LocalFeatures]) -> None:
    routes = LINE.reshape(10, 4)[[0, 5, 2, 7, 4, 9, 6, 1, 8, 3]]
    bounds = [(start, start + 4) for start in range(0, PLACES, 4)]
    apart = [views[place] for place in routes.ravel()]
    by_routes, as_one = (features_of_places(apart, [], LINE, given, 0) for given in (bounds, WHOLE))
    assert by_routes is not None
    assert as_one is not None
    few = by_routes.ratios[:8].max(), as_one.ratios[:8].max()
    assert few[0] < few[1]  # by chance only, if no views of two places count as those of one


def test_a_map_too_small_for_two_places_and_one_without_texture_have_none(
    views: list[LocalFeatures],
) -> None:
    assert features_of_places(views[:5], [], LINE[:5], [(0, 5)], 0) is None
    blank = [extract(np.full((60, 80), 9, np.uint8), 10)] * PLACES
    assert features_of_places(blank, [], LINE, WHOLE, 0) is None


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
        "ratios": -built.local_features.ratios,
        "points": np.full_like(built.local_features.points, np.nan),
    }
    for name, array in wrong.items():
        spoilt = replace(built.local_features, **{name: array})
        save_map(replace(built, local_features=spoilt), tmp_path / "spoilt.pfmap")
        with pytest.raises(MapError, match="local_features"):
            open_map(tmp_path / "spoilt.pfmap")


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
    assert verify(shrunk, 0, 0.9, views[3], 0) == verify(places, 2, 0.9, views[3], 0)


def test_a_place_without_local_features_says_nothing(
    views: list[LocalFeatures], places: PlaceFeatures
) -> None:
    grown = places.with_places([NO_FEATURES])
    assert verify(grown, PLACES, 0.9, views[0], 0)[1:] == (1, pytest.approx(0.9))
