from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from placefield.config import MetricConfig
from placefield.maps.manifest import TraverseRecord
from placefield.maps.map import Map
from placefield.maps.map_metrics import with_looks
from placefield_tools.inspect.map_facts import map_facts


def test_how_far_it_is_along_the_places_is_reported_where_it_is_known(route_map: Map) -> None:
    assert map_facts(route_map)["travelled"] == "unknown"
    places = replace(route_map.places, travelled=np.linspace(0, 29.5, 60))
    reported = map_facts(replace(route_map, places=places))["travelled"]
    assert reported == "29.5 m, 0.50 m from place to place on average"


def test_how_many_places_are_driven_again_is_reported(route_map: Map) -> None:
    assert map_facts(route_map)["revisited"] == "no place"
    same = np.arange(60, dtype=np.int32)
    same[50:] = range(10)
    reported = map_facts(replace(route_map, places=replace(route_map.places, same=same)))
    assert reported["revisited"] == "10 places are the same as earlier ones"


def test_how_many_places_have_no_pose_is_reported(route_map: Map) -> None:
    assert map_facts(route_map)["places"] == "60, without poses"
    poses = np.zeros((60, 3))
    poses[:7] = np.nan
    with_poses = replace(
        route_map, pose_frame="wgs84 1.0 2.0", places=replace(route_map.places, poses=poses)
    )
    reported = map_facts(with_poses)["places"]
    assert reported == "60, with poses georeferenced at 1.000000 2.000000, 7 places without"
    assert with_poses.places.pose(6) is None
    assert with_poses.places.pose(7) == (0, 0, 0)


def test_how_images_are_decoded_is_reported(route_map: Map) -> None:
    reported = map_facts(route_map)["decoding"]
    assert reported == "JPEG to a part of its size, of at least 240 pixels a side"
    whole = replace(route_map, model=replace(route_map.model, least_side=None))
    assert map_facts(whole)["decoding"] == "whole frames"


def test_how_other_traverses_were_aligned_is_reported(route_map: Map) -> None:
    first = TraverseRecord(name="day", frames=60)
    night = TraverseRecord(name="night", frames=90, aligned=81, by="smoother")
    reported = map_facts(replace(route_map, traverses=(first, night)))["traverses"]
    assert reported == "day: 60 frames; night: 90 frames, 81 aligned by smoother, 9 left out"


def test_why_a_metric_was_not_kept_is_reported(route_map: Map) -> None:
    assert map_facts(route_map)["metric"] == "identity"
    first, *others = route_map.channels
    kept = replace(first, metric=replace(first.metric, learned=True), refusal="")
    channels = (kept, *(replace(channel, refusal="of no use") for channel in others))
    learned = replace(route_map, metric=MetricConfig(), channels=channels)
    reported = map_facts(learned)["metric"]
    assert reported == "lmnn, push 0.5: kept in 1 of 3 channels; else the identity: of no use"


def test_a_map_is_reported_by_its_digest(map_path: Path, route_map: Map) -> None:
    written = (map_path / "manifest.json").read_bytes()
    assert map_facts(route_map)["digest"] == sha256(written).hexdigest()[:16]


def test_how_many_looks_there_are_and_what_they_cost_is_reported(route_map: Map) -> None:
    assert map_facts(route_map)["looks"] == "one of each place"
    metric = route_map.metrics[0]
    shown = np.arange(20, 45, dtype=np.int32)
    looked = with_looks(metric, shown, metric.places[shown])
    channels = tuple(replace(channel, metric=looked) for channel in route_map.channels)
    reported = map_facts(replace(route_map, channels=channels, identity=looked))["looks"]
    assert reported.startswith("25 more of 25 places, 0.0 MB; a frame is compared with 85 ")
    assert "instead of 60 in each metric" in reported
    dusk = TraverseRecord(name="dusk/", frames=60, aligned=60, by="smoother")
    seen = with_looks(metric, shown, metric.places[shown], np.ones(25, np.int32))
    recorded = replace(route_map, traverses=(*route_map.traverses, dusk), identity=seen)
    assert map_facts(recorded)["looks"].startswith("25 more of 25 places (25 by dusk/), 0.0 MB; ")
