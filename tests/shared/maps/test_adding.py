"""Drives that are added to a map, and dropped from it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.adding import Addition, add_traverse, check_growable
from placefield.maps.dropping import drop_traverse, number_of
from placefield.maps.map import STEPS, Map
from placefield.maps.map_metrics import identity_metric, learned_metric
from placefield.maps.opening import open_map
from placefield.maps.route_graph import problem_of
from placefield.maps.store import save_map
from placefield.maps.traverse import Traverse

MakeTraverse = Callable[..., Traverse]
MakeMap = Callable[[Traverse], Map]
ROAD = 200
"""Frames of the whole road."""


def some(traverse: Traverse, frames: NDArray[np.int64], name: str) -> Traverse:
    """Return a traverse of some of the frames of another one."""
    return replace(
        traverse,
        name=name,
        raw=traverse.raw[frames],
        stamps=traverse.stamps[frames],
        poses=traverse.poses[frames] if len(traverse.poses) else traverse.poses,
        travelled=traverse.travelled[frames] if len(traverse.travelled) else traverse.travelled,
        thumbnails=tuple(traverse.thumbnails[frame] for frame in frames.tolist()),
    )


@pytest.fixture(scope="module")
def road(make_traverse: MakeTraverse) -> Traverse:
    return make_traverse(ROAD, name="day")


@pytest.fixture(scope="module")
def later(make_traverse: MakeTraverse) -> Traverse:
    """The whole road, in another light."""
    return make_traverse(ROAD, name="night", noise=0.4)


@pytest.fixture(scope="module")
def middle(road: Traverse, make_map: MakeMap) -> Map:
    """A map of the frames 60 to 139 of the road."""
    return make_map(some(road, np.arange(60, 140), "day"))


@pytest.fixture(scope="module")
def grown(middle: Map, later: Traverse) -> Addition:
    return add_traverse(middle, later)


def assert_equal(one: Map, other: Map, tmp_path: Path) -> None:
    """Assert that two maps have the same files, bit for bit."""
    paths = [tmp_path / f"{name}.pfmap" for name in ("one", "other")]
    files = []
    for path, placemap in zip(paths, (one, other), strict=True):
        save_map(placemap, path)
        files.append({str(f.relative_to(path)): f.read_bytes() for f in path.rglob("*.npy")})
    assert files[0] == files[1]


def test_a_drive_adds_looks_and_the_stretches_before_and_behind(
    grown: Addition, middle: Map
) -> None:
    placemap, first = grown.map, middle.places.count
    assert placemap.graph.names == ("day", "night", "night (2)")
    (before, last), (after, start) = sorted(placemap.graph.links.tolist(), reverse=True)
    assert placemap.graph.first.tolist() == [0, first, start]
    assert (before, last) == (start - 1, 0) or last <= 3
    assert first - 4 <= after < first
    assert problem_of(placemap.graph, placemap.places.count) is None
    aligned = placemap.alignments[1].places
    assert aligned[5] == first + 5
    on_map = aligned[65:135]
    assert np.mean(np.abs(on_map - np.arange(5, 75))[on_map >= 0] <= 1) >= 0.95
    assert placemap.identity is not None
    assert placemap.identity.looks is not None
    assert grown.looks == len(placemap.identity.looks.places)
    assert set(placemap.identity.looks.places.tolist()) <= set(range(first))
    assert placemap.history[0].drive == "night"
    assert placemap.places.same.tolist() == list(range(placemap.places.count))


def test_the_places_that_were_there_stay_as_they_were(grown: Addition, middle: Map) -> None:
    count = middle.places.count
    for one, other in zip(middle.metrics, grown.map.metrics, strict=True):
        np.testing.assert_array_equal(one.places, other.places[:count])
        # The first places may have places before them now.
        np.testing.assert_array_equal(one.steps[:, STEPS:], other.steps[:, STEPS:count])
    assert grown.map.places.thumbnail(count - 1) == middle.places.thumbnail(count - 1)
    assert grown.map.places.thumbnail(count) == b"thumbnail 0"
    for one, other in zip(middle.channels, grown.map.channels, strict=True):
        np.testing.assert_array_equal(one.labels, other.labels[:count])


def test_a_grown_map_comes_back_from_disk_and_grows_again(
    grown: Addition, later: Traverse, tmp_path: Path
) -> None:
    save_map(grown.map, tmp_path / "route.pfmap")
    opened = open_map(tmp_path / "route.pfmap")
    again = add_traverse(opened, replace(later, name="again"))
    assert again.places == 0
    assert again.map.traverses[2].aligned > 0.85 * ROAD
    assert [change.before for change in again.map.history][1] == opened.digest


@pytest.mark.parametrize("coarse", [False, True])
def test_adding_and_dropping_gives_the_map_from_before(
    road: Traverse,
    later: Traverse,
    make_map: MakeMap,
    make_traverse: MakeTraverse,
    tmp_path: Path,
    coarse: bool,
) -> None:
    built = make_map(some(road, np.arange(60, 140), "day"))
    descriptors = (built.metrics[0].unit * built.metrics[0].places).astype(np.float32)
    identity = identity_metric(descriptors, coarse=coarse)
    learned = learned_metric(2 * identity.projection[:20], descriptors, coarse=coarse)
    first, other = built.channels
    built = replace(
        built,
        identity=identity,
        channels=(replace(first, metric=learned), replace(other, metric=identity)),
    )
    dusk = some(make_traverse(ROAD, noise=0.3), np.arange(60, 140), "dusk")
    with_dusk = add_traverse(built, dusk).map
    both = add_traverse(with_dusk, later).map
    assert both.places.count > built.places.count
    assert_equal(drop_traverse(both, 2), with_dusk, tmp_path)
    without = drop_traverse(both, 1)
    assert [record.name for record in without.traverses] == ["day", "night"]
    assert without.graph.first.tolist() == both.graph.first.tolist()
    assert_equal(drop_traverse(drop_traverse(both, 2), 1), built, tmp_path)
    assert_equal(drop_traverse(without, 1), built, tmp_path)


def test_a_drive_whose_new_places_a_later_one_shows_is_dropped_after_that_one(
    grown: Addition, later: Traverse
) -> None:
    again = add_traverse(grown.map, replace(later, name="again")).map
    with pytest.raises(MapError, match="night: added places that again shows, too"):
        drop_traverse(again, 1)
    assert drop_traverse(drop_traverse(again, 2), 1).places.count == 80


def test_a_drive_in_the_same_light_adds_hardly_a_look(road: Traverse, make_map: MakeMap) -> None:
    again = add_traverse(make_map(road), replace(road, name="again"))
    assert again.places == 0
    assert again.looks <= 1
    assert again.pruned > 0.9 * ROAD


def test_a_stretch_that_was_not_recognised_is_no_new_one(
    road: Traverse, later: Traverse, make_map: MakeMap
) -> None:
    fog = later.raw.copy()
    fog[80:130] = 5 + np.random.default_rng(1).normal(size=(50, 30))
    added = add_traverse(make_map(road), replace(later, raw=fog))
    assert added.map.traverses[1].aligned < ROAD - 40
    assert added.places == 0


def test_a_slow_drive_has_not_a_place_of_each_frame(middle: Map, later: Traverse) -> None:
    slow = np.sort(np.r_[np.repeat(np.arange(60), 5), np.arange(60, ROAD)])
    jitter = np.random.default_rng(2).normal(scale=0.01, size=(len(slow), 30))
    drive = some(later, slow, "slow")
    added = add_traverse(middle, replace(drive, raw=(drive.raw + jitter).astype(np.float32)))
    assert 100 <= added.places <= 135


def test_poses_tell_a_new_stretch_and_which_frames_show_a_place(
    road: Traverse, make_map: MakeMap, make_traverse: MakeTraverse
) -> None:
    frame = "wgs84 52.000000 13.000000"
    metres = np.column_stack([6.0 * np.arange(ROAD), np.zeros((ROAD, 2))])
    placed = replace(road, poses=metres, pose_frame=frame, travelled=metres[:, 0])
    placemap = make_map(some(placed, np.arange(ROAD), "day"))
    detour = metres.copy()
    detour[100:130, 1] = 30
    night = make_traverse(ROAD, name="night", noise=0.4)
    drive = replace(night, poses=detour, pose_frame=frame, travelled=metres[:, 0])
    added = add_traverse(placemap, drive)
    assert added.map.traverses[1].by == "poses"
    assert added.map.graph.links.tolist() == [[99, ROAD], [ROAD + added.places - 1, 130]]
    np.testing.assert_allclose(added.map.places.poses[ROAD:, 1], 30)
    metres_there = added.map.places.travelled
    assert metres_there[ROAD] == metres_there[ROAD - 1]
    assert (np.diff(metres_there) >= 0).all()
    unmeasured = add_traverse(placemap, replace(drive, travelled=np.empty(0)))
    assert unmeasured.places == 0
    assert unmeasured.left_out == added.places


def test_blank_frames_become_neither_looks_nor_places(middle: Map, later: Traverse) -> None:
    raw = later.raw.copy()
    raw[80:90] = 3
    raw[10:20] = 3
    clear = add_traverse(middle, later)
    blank = add_traverse(middle, replace(later, raw=raw))
    assert blank.looks < clear.looks
    assert blank.places <= clear.places - 10
    assert blank.map.identity is not None
    known = blank.map.identity.places.astype(np.float64)
    assert (np.linalg.norm(known, axis=1) > 3990).all()


def test_a_drive_of_another_route_is_refused_with_what_was_recognised(
    middle: Map, make_traverse: MakeTraverse
) -> None:
    other = replace(make_traverse(120, name="other"))
    raw = 5 + np.cumsum(np.random.default_rng(77).normal(scale=0.3, size=(120, 30)), axis=0)
    with pytest.raises(MapError, match=r"other: does not show the route .*only 0% of its frames"):
        add_traverse(middle, replace(other, raw=raw.astype(np.float32)))


def test_a_name_is_given_once(grown: Addition, later: Traverse) -> None:
    with pytest.raises(MapError, match=r"night/: the map has a drive of this name.*--name"):
        add_traverse(grown.map, replace(later, name="night/"))


def test_a_map_without_what_growing_needs_is_refused(middle: Map, grown: Addition) -> None:
    with pytest.raises(MapError, match="build the map again"):
        check_growable(replace(middle, identity=None))
    identity = grown.map.identity
    assert identity is not None
    assert identity.looks is not None
    unknown = replace(identity, looks=replace(identity.looks, traverses=None))
    with pytest.raises(MapError, match="build the map again"):
        check_growable(replace(grown.map, identity=unknown))
    plain = replace(middle, model=replace(middle.model, plain=True))
    with pytest.raises(MapError, match="plain PCA"):
        check_growable(plain)


@pytest.mark.parametrize(
    ("drive", "found"),
    [
        ("night", 1),
        ("night/", 1),
        ("1", 1),
        ("day", "day: its frames are the places"),
        ("0", "0: its frames are the places"),
        ("dusk", "dusk: no drive of the map; there is night"),
        ("2", "2: no drive of the map"),
        ("-1", "-1: no drive of the map"),
    ],
)
def test_a_drive_is_named_by_its_name_or_number(grown: Addition, drive: str, found: Any) -> None:
    if isinstance(found, int):
        assert number_of(grown.map.traverses, drive) == found
        return
    with pytest.raises(MapError) as refused:
        number_of(grown.map.traverses, drive)
    assert found in str(refused.value)


def test_a_drive_is_named_by_the_end_of_its_path(grown: Addition) -> None:
    day, night = grown.map.traverses
    paths = [day, night.model_copy(update={"name": "/data/night/"})]
    assert number_of(paths, "night") == number_of(paths, "/data/night") == 1


def test_of_drives_of_one_name_the_number_is_asked_for(grown: Addition) -> None:
    record = grown.map.traverses[1]
    with pytest.raises(MapError, match=r"night: several drives have this name; .* 1 or 2"):
        number_of((*grown.map.traverses, record), "night")
