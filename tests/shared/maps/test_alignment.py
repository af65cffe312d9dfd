"""Frames of real drives are aligned to the places that they show, at any speed, start and end."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.features.extract import feature_of
from placefield.features.fitting import fit_descriptors
from placefield.maps.alignment import align_by_number, align_by_poses, align_by_smoother
from placefield.maps.map_metrics import identity_metric
from placefield.maps.topology import Topology
from placefield.maps.traverse import Alignment
from placefield.matching.revisits import same_places

Raws = dict[str, NDArray[np.float32]]
DAY, LEFT, NIGHT = "gardens_point/day_right", "gardens_point/day_left", "gardens_point/night_right"
NUMBERS = np.arange(200)


@pytest.fixture(scope="module")
def raws(data_dir: Path) -> Raws:
    describe = feature_of("gist").describe
    return {
        name: np.stack(
            [describe(file.read_bytes()) for file in sorted((data_dir / name).iterdir())]
        )
        for name in (LEFT, DAY, NIGHT, "corridor/ref")
    }


def align(reference: NDArray[np.float32], drive: NDArray[np.float32]) -> Alignment:
    _, (places, frames) = fit_descriptors(
        [reference, drive], "gist", dimensions=300, standardise=True
    )
    return align_by_smoother(
        identity_metric(places),
        replace(Topology.line(len(places)), same=same_places(places)),
        frames,
    )


DRIVES = {
    "as driven": NUMBERS,
    "every third frame missing, cut": np.array([n for n in NUMBERS[20:-20] if n % 3 != 2]),
    "every third frame, cut": NUMBERS[20:-20:3],
    "stops, and a stretch at twice the speed": np.r_[0:66, [66] * 15, 66:132:2, [132] * 8, 132:200],
    "slower": np.repeat(NUMBERS, np.random.default_rng(0).choice([1, 1, 1, 2, 3], 200)),
}


@pytest.mark.parametrize("other", [DAY, NIGHT], ids=["day", "night"])
@pytest.mark.parametrize("frames", DRIVES.values(), ids=DRIVES)
def test_a_drive_is_aligned_within_a_place(
    raws: Raws, other: str, frames: NDArray[np.int64]
) -> None:
    alignment = align(raws[LEFT], raws[other][frames])
    shown = alignment.places >= 0
    off = np.abs(alignment.places - frames)[shown]
    assert shown.mean() > 0.9
    assert np.mean(off <= 1) >= 0.95
    assert off.max() <= 2
    assert alignment.aligned == np.count_nonzero(shown)
    assert (alignment.probability[shown] >= 0.99).all()


def test_frames_of_another_route_in_between_are_left_out(raws: Raws) -> None:
    night, corridor = raws[NIGHT], raws["corridor/ref"]
    alignment = align(raws[LEFT], np.concatenate([night[:100], corridor, night[100:]]))
    assert (alignment.places[100:211] == -1).all()
    rest = np.delete(alignment.places, slice(100, 211))
    assert np.mean(rest >= 0) > 0.85
    assert np.abs(rest - NUMBERS)[rest >= 0].max() <= 2


@pytest.mark.parametrize("turn", [1, -1], ids=["another route", "the other way"])
def test_a_drive_that_does_not_show_the_route_shows_no_place(raws: Raws, turn: int) -> None:
    drive = raws["corridor/ref"] if turn > 0 else raws[NIGHT][::-1]
    assert align(raws[LEFT], drive).aligned == 0


def test_poses_give_the_nearest_place_in_the_same_heading() -> None:
    metres = np.arange(10.0)
    there = np.column_stack([metres * 3, np.zeros(10), np.zeros(10)])
    back = np.column_stack([metres[::-1] * 3, np.ones(10), np.full(10, -np.pi)])
    reference = np.concatenate([there, back])
    asked = np.array(
        [
            [6.4, 0.6, 0.1],
            [6.4, 0.4, np.pi],
            [0, 4.9, 0],
            [0, 6.1, np.pi / 2],
            [np.nan, 0, 0],
            [40, 0, 0],
        ]
    )
    alignment = align_by_poses(reference, asked)
    assert alignment.by == "poses"
    np.testing.assert_array_equal(alignment.places, [2, 17, 0, -1, -1, -1])


def test_places_without_poses_are_never_aligned() -> None:
    reference = np.zeros((5, 3))
    reference[:, 0] = np.arange(5)
    reference[2] = np.nan
    assert align_by_poses(reference, np.array([[2.1, 0, 0]])).places.tolist() == [3]
    assert align_by_poses(np.full((5, 3), np.nan), reference).aligned == 0
    assert align_by_poses(reference, np.full((4, 3), np.nan)).aligned == 0


def test_of_frames_that_show_one_place_the_likeliest_is_chosen() -> None:
    places = np.array([4, 4, -1, 4, 7, 2], np.int32)
    probability = np.array([0.995, 0.999, 0.2, 0.999, 1, 1], np.float32)
    alignment = Alignment(places, probability, "smoother")
    assert alignment.shown().tolist() == [1, 4, 5]
    assert alignment.aligned == 5
    assert align_by_number(3).shown().tolist() == [0, 1, 2]
