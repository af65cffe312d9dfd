"""A map of a network and GIST, from its frames to the answers of the services."""

import signal
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hosting import Host, Process, answers_of, offline, wait_until
from networks import write_network

import placefield
from placefield.bus.messages import RawFeatureMessage
from placefield.config import Config
from placefield.maps.map import fingerprint
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_tools.build.added_drive import add_drive
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.sources import NO_PARTS


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


def test_services_answer_as_the_library_does_whichever_of_them_are_killed(
    joined_path: Path, query_dir: Path, logs: Path
) -> None:
    images = sorted(query_dir.iterdir())
    parts: defaultdict[str, set[int]] = defaultdict(set)  # that each describer has sent
    with (
        Host(logs, joined_path, "--workers", "1", "--describers", "1") as host,
        Process(
            logs, "describer", joined_path, "--part", "net", "--endpoint", host.endpoint
        ) as of_network,
        host.listener() as listener,
        placefield.connect(host.endpoint) as client,
    ):
        wait_until(lambda: len(listener.alive("describer")) == 2, "both are ready")
        listener.bus.subscribe_raw(
            listener.keys.all_raws,
            lambda key, payload: parts[key].add(RawFeatureMessage.decode(payload).part),
        )

        def sent() -> Iterator[Path]:
            faults: dict[int, Callable[[], object]] = {
                20: lambda: host.service("featurizer")[0].kill(),
                40: lambda: host.service("describer")[0].kill(),
                50: lambda: of_network.stop(signal.SIGKILL),
            }
            for number, image in enumerate(images):
                if number in faults:
                    faults[number]()
                yield image

        assert len(list(client.stream(sent()))) == len(images)
        assert answers_of(listener.answers()) == offline(open_map(joined_path), images)
        assert {0} in parts.values(), "the describer of any part takes the part that is left"
        assert {1} in parts.values(), "the describer of the network describes only that"
        assert "defect" not in host.err + of_network.err


def test_a_drive_is_added_with_the_features_of_the_map(joined_path: Path, query_dir: Path) -> None:
    opened = open_map(joined_path)
    added = add_drive(
        opened, str(query_dir), "later", spacing_m=None, parts=NO_PARTS, leave_out_bad=False
    )
    assert added.places == 0
    assert 0 < added.looks + added.pruned <= 60
