"""A map of a network and GIST, from its frames to the answers of the services."""

from pathlib import Path

import numpy as np
import pytest
from networks import write_network

from placefield.config import Config
from placefield.maps.map import fingerprint
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.recognizer import Recognizer
from placefield_tools.build.added_drive import add_drive
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.evaluate.through_services import match_through_services
from placefield_tools.sources import NO_PARTS, open_source


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Config:
    network = tmp_path_factory.mktemp("network") / "net.onnx"
    write_network(network)
    return Config.model_validate(
        {
            "features": {"kind": f"gist+onnx:{network}"},
            "scales": {"channels": 2},
            "metric": {"kind": "identity"},
        }
    )


@pytest.fixture(scope="module")
def joined_path(
    config: Config, reference_dir: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    path = tmp_path_factory.mktemp("map") / "joined.pfmap"
    save_map(build_from([str(reference_dir)], config), path)
    return path


def test_a_saved_map_has_the_model_that_it_was_built_with(
    config: Config, joined_path: Path, reference_dir: Path
) -> None:
    built, opened = build_from([str(reference_dir)], config), open_map(joined_path)
    assert fingerprint(built.model) == fingerprint(opened.model)
    raws = np.random.default_rng(0).random((3, opened.model.raw_dimensions), np.float32)
    found = opened.model.of_reference(raws)
    np.testing.assert_array_equal(found, built.model.of_reference(raws))
    assert [part.variance_kept for part in opened.model.parts] == [
        part.variance_kept for part in built.model.parts
    ]


def test_services_answer_as_the_library_does(
    config: Config, joined_path: Path, query_dir: Path
) -> None:
    recognizer = Recognizer(open_map(joined_path), config)
    with open_source(str(query_dir)) as source:
        expected = [recognizer.update_frame(frame) for frame in source]
        found, _ = match_through_services(joined_path, source, config)
    assert found == expected
    places = np.array([match.place for match in found])
    assert (np.abs(places - np.arange(60)) <= 3).mean() > 0.9


def test_a_drive_is_added_with_the_features_of_the_map(joined_path: Path, query_dir: Path) -> None:
    opened = open_map(joined_path)
    added = add_drive(
        opened, str(query_dir), "later", spacing_m=None, parts=NO_PARTS, leave_out_bad=False
    )
    assert added.places == 0
    assert 0 < added.looks + added.pruned <= 60
