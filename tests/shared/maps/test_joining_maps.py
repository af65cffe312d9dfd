"""Maps of parts become one map, which recognises as well as one that is built of the frames."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from traverse_parts import part

from placefield.config import Config
from placefield.errors import MapError
from placefield.maps.build import build_map
from placefield.maps.joining_maps import check_joinable, config_of, traverses_of, with_records
from placefield.maps.joining_routes import join_routes
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.maps.traverse import Traverse
from placefield.verification.local_features import LocalFeatures

Make = Callable[..., Traverse]
CONFIG = Config.model_validate(
    {"scales": {"channels": 2}, "metric": {"kind": "identity"}, "build": {"looks": True}}
)


def join(maps: list[Map]) -> Map:
    return with_records(build_map(traverses_of(maps), config_of(maps)), maps)


def descriptors_of(built: Map) -> np.ndarray:
    assert built.identity is not None
    return built.identity.places.astype(np.float64)


def similarities(built: Map) -> np.ndarray:
    units = descriptors_of(built)
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    return np.asarray(units @ units.T)


def test_places_resemble_each_other_as_in_a_map_that_is_built_of_the_frames(
    make_traverse: Make,
) -> None:
    whole = make_traverse(160)
    parts = [part(whole, "A", slice(100)), part(whole, "B", slice(70, 160))]
    built = build_map([join_routes(parts)], CONFIG)
    made = join([build_map([each], CONFIG) for each in parts])
    assert made.graph.names == ("A", "B")
    assert made.graph.first.tolist() == [0, 100]
    assert [record.name for record in made.traverses] == ["A", "B"]
    ours, theirs = similarities(made), similarities(built)
    assert np.corrcoef(ours.ravel(), theirs.ravel())[0, 1] > 0.95


def test_looks_and_alignments_of_all_maps_are_kept(make_traverse: Make) -> None:
    whole, night = make_traverse(160), make_traverse(160, noise=0.1)
    maps = [
        build_map(
            [part(whole, f"day {name}", frames), part(night, f"night {name}", frames)], CONFIG
        )
        for name, frames in (("A", slice(80)), ("B", slice(80, 160)))
    ]
    made = join(maps)
    names = ["day A", "night A", "day B", "night B"]
    assert [record.name for record in made.traverses] == names
    assert {number: each.places[0] for number, each in made.alignments.items()} == {1: 0, 3: 80}
    assert made.identity is not None
    looks = made.identity.looks
    assert looks is not None
    assert looks.traverses is not None
    np.testing.assert_array_equal(looks.traverses, np.where(looks.places < 80, 1, 3))
    # Each look resembles its own place most.
    similar = looks.descriptors.astype(np.float64) @ descriptors_of(made).T
    assert np.mean(np.abs(similar.argmax(axis=1) - looks.places) <= 3) > 0.95


def test_a_joined_map_is_saved_opened_and_joined_again(
    make_traverse: Make, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("joined") / "town.pfmap"
    parts = [
        part(make_traverse(180), name, slice(at, at + 60))
        for name, at in (("A", 0), ("B", 60), ("C", 120))
    ]
    maps = [build_map([each], CONFIG) for each in parts]
    save_map(join(maps[:2]), path)
    save_map(join([open_map(path), maps[2]]), path)
    assert open_map(path).graph.names == ("A", "B", "C")


def test_maps_of_different_features_or_of_an_earlier_version_are_refused(
    make_traverse: Make,
) -> None:
    one = build_map([make_traverse(90)], CONFIG)
    as_they_are = CONFIG.model_copy(
        update={"features": CONFIG.features.model_copy(update={"standardise": False})}
    )
    other = build_map([make_traverse(90)], as_they_are)
    with pytest.raises(MapError, match=r"as they are, and those of the first map .*standardised"):
        check_joinable(one, other)
    decoded = replace(one, model=replace(one.model, least_side=128))
    with pytest.raises(MapError, match="its images are decoded to another size"):
        check_joinable(one, decoded)
    with pytest.raises(MapError, match="an earlier version built it"):
        check_joinable(one, replace(one, identity=None))


def test_maps_of_different_networks_of_local_features_are_refused(make_traverse: Make) -> None:
    views = (LocalFeatures(np.ones((2, 2), np.float32), np.ones((2, 64), np.uint8)),) * 90
    route, onnx = make_traverse(90), np.arange(9, dtype=np.uint8)
    one, other, without = (
        build_map([replace(route, local_features=local, local_network=network)], CONFIG)
        for local, network in ((views, onnx), (views, onnx[:8]), ((), None))
    )
    with pytest.raises(MapError, match="its local features are of another kind"):
        check_joinable(one, other)
    check_joinable(without, one)
    joined = join([without, one]).local_features
    assert joined is not None
    np.testing.assert_array_equal(joined.onnx, onnx)
