import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.evaluation.pose_truth import OFF_ROUTE_M, pose_truth
from placefield.evaluation.truth import Truth

STRAIGHT = np.column_stack([2.0 * np.arange(50), np.zeros(50)])


def right(truth: Truth, frame: int) -> list[int]:
    return [
        place
        for place in range(200)
        if truth.correct(np.where(np.arange(truth.queries) == frame, place, -1))[frame]
    ]


@given(st.integers(0, 10**6), st.floats(0.5, 20))
def test_in_metres_every_place_that_is_near_enough_is_right(seed: int, metres: float) -> None:
    rng = np.random.default_rng(seed)
    query, places = rng.uniform(-9, 9, (5, 2)), rng.uniform(-9, 9, (30, 2))
    truth = pose_truth(query, places, tolerance=0, metres=metres)
    for frame in range(5):
        near = [
            place
            for place in range(30)
            if sum((query[frame] - places[place]) ** 2) ** 0.5 <= metres
        ]
        assert right(truth, frame) == near
        assert truth.on_route[frame] == bool(near)
    assert truth.judged is not None
    assert truth.judged.all()


@pytest.mark.parametrize("spacing", [0.3, 1.0, 5.0])
@pytest.mark.parametrize("lane", [0.0, 4.0])
def test_in_places_the_nearest_and_those_beside_it_are_right_at_any_spacing(
    spacing: float, lane: float
) -> None:
    along = np.arange(0.0, 98.0, spacing)
    truth = pose_truth(np.column_stack([along, np.full(len(along), lane)]), STRAIGHT, tolerance=3)
    nearest = np.rint(along / 2).astype(int)
    assert truth.on_route.all()
    for offset in (-3, 0, 3):
        inside = np.clip(nearest + offset, 0, 49)
        assert truth.correct(inside).all()
    if lane == 0:
        assert not truth.correct(nearest + 5).any()


def test_the_same_spot_of_another_lap_is_right_too() -> None:
    laps = np.concatenate([STRAIGHT, STRAIGHT])
    assert right(pose_truth(STRAIGHT[[20]], laps, tolerance=1), 0) == [19, 20, 21, 69, 70, 71]


def test_a_frame_far_from_all_places_is_off_the_route() -> None:
    query = np.array([[10.0, OFF_ROUTE_M - 1], [10.0, OFF_ROUTE_M + 1]])
    truth = pose_truth(query, STRAIGHT, tolerance=2)
    assert truth.on_route.tolist() == [True, False]
    assert truth.judged is not None
    assert truth.judged.all()


def test_a_frame_without_a_known_position_is_not_judged() -> None:
    places = STRAIGHT.copy()
    places[20:30] = np.nan
    query = STRAIGHT.copy()
    query[40] = np.nan
    truth = pose_truth(query, places, tolerance=2)
    assert truth.judged is not None
    assert np.flatnonzero(~truth.judged).tolist() == [*range(19, 31), 40]
    nowhere = pose_truth(query, np.full((9, 2), np.nan), tolerance=2)
    assert nowhere.judged is not None
    assert not nowhere.judged.any()


def test_a_resampled_traverse_keeps_which_frames_are_judged_and_foreign_ones_are() -> None:
    query = STRAIGHT.copy()
    query[3] = np.nan
    truth = pose_truth(query, STRAIGHT, tolerance=2)
    foreign = np.array([False, True, False])
    resampled = truth.along(np.array([3, 99, 4]), foreign)
    assert resampled.judged is not None
    assert resampled.judged.tolist() == [False, True, True]
