"""Real frames: a reference that drives its route twice, here and through the services."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from shutil import copy

import numpy as np
import pytest

from placefield.config import Config
from placefield.maps.opening import open_map
from placefield_tools.build.map_from_sources import map_of
from placefield_tools.cli import options_truth
from placefield_tools.evaluate.evaluation import Evaluation, evaluate
from placefield_tools.evaluate.query import Query

LAP = 200  # frames
TRUTH = partial(options_truth.truth_of, tolerance=3, truth=None)
# A deadline as long as the test: a machine that is busy with others misses none of its own.
CONFIG = Config.model_validate({"fusion": {"deadline_s": 300}})


@pytest.fixture(scope="module")
def laps_path(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A map of a lap on the left of the path, and one on the right."""
    folder = tmp_path_factory.mktemp("laps")
    for side in ("day_left", "day_right"):
        for file in (data_dir / "gardens_point" / side).glob("*.jpg"):
            copy(file, folder / f"{side}_{file.name}")
    with map_of(str(folder), CONFIG, feature_asked=False) as path:
        yield path


def at_night(data_dir: Path, map_path: Path, *, services: bool = False) -> Evaluation:
    query = Query(str(data_dir / "gardens_point" / "night_right"))
    return evaluate(map_path, query, TRUTH, CONFIG, services=services)


def test_the_second_lap_shows_the_first_again(laps_path: Path) -> None:
    same = open_map(laps_path).places.same
    assert same[:LAP].tolist() == [*range(LAP)]
    assert np.mean(np.abs(same[LAP:] - np.arange(LAP)) <= 2) >= 0.95


def test_two_laps_make_as_many_frames_known_as_one(data_dir: Path, laps_path: Path) -> None:
    with map_of(str(data_dir / "gardens_point" / "day_left"), CONFIG, feature_asked=False) as lap:
        alone = at_night(data_dir, lap)
    shared = at_night(data_dir, laps_path)
    for one, two in (
        (alone.results["filter"], shared.results["filter"]),
        (alone.smoothed["filter"][20], shared.smoothed["filter"][20]),
    ):
        assert one.claims is not None
        assert two.claims is not None
        assert two.claims.precision >= 0.99
        assert two.claims.recall >= 0.95 * one.claims.recall


def test_the_services_share_the_laps_as_the_library_does(data_dir: Path, laps_path: Path) -> None:
    here = at_night(data_dir, laps_path)
    there = at_night(data_dir, laps_path, services=True)
    for rule, judged in here.results.items():
        np.testing.assert_array_equal(there.results[rule].places, judged.places)
        np.testing.assert_array_equal(there.results[rule].scores, judged.scores)
        smoothed = there.smoothed[rule][20]
        np.testing.assert_array_equal(smoothed.scores, here.smoothed[rule][20].scores)
