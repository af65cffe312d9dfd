"""A map that is built for a coarse search finds, through the recognizer, what exact search does."""

from pathlib import Path

import numpy as np

from placefield.config import Config, MatchingConfig
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.recognizer import Recognizer
from placefield_tools.bench.random_walks import drive_along, observed_again, random_walk
from placefield_tools.bench.synthetic import made_map


def test_a_coarse_map_and_an_exact_search_of_it_agree(tmp_path: Path) -> None:
    walk = random_walk(30_000, 120, seed=0)
    drive = drive_along(len(walk), 150, seed=1)
    query = observed_again(walk[drive], 0.7, seed=2)
    save_map(made_map(walk, coarse=True), tmp_path / "walk.pfmap")
    placemap = open_map(tmp_path / "walk.pfmap")
    assert all(metric.coarse is not None for metric in placemap.metrics)
    coarse = Recognizer(placemap, Config(matching=MatchingConfig()))
    exact = Recognizer(placemap, Config(matching=MatchingConfig(exact=True)))
    found = np.array([coarse.update_descriptor(frame).place for frame in query])
    expected = np.array([exact.update_descriptor(frame).place for frame in query])
    assert np.mean(found == expected) >= 0.99
    assert np.mean(np.abs(found - drive) <= 3) > 0.8


def test_other_rules_compare_exactly_whatever_the_map(tmp_path: Path) -> None:
    walk = random_walk(5000, 60, seed=0)
    query = observed_again(walk[100:140], 0.5, seed=1)
    answers = []
    for coarse in (False, True):
        recognizer = Recognizer(
            made_map(walk, coarse=coarse), Config(matching=MatchingConfig(rule="evidence"))
        )
        answers.append([recognizer.update_descriptor(frame) for frame in query])
    assert answers[0] == answers[1]
