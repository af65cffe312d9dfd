from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.evaluation.protocols import (
    THINS_REFERENCE,
    Protocol,
    Resampling,
    default_every,
    drive_of,
    frames_to_recover,
    kidnap,
    odometry,
    off_route,
    speed,
)

PROTOCOLS: tuple[Protocol, ...] = get_args(Protocol)
FOREIGN = 50

counts = st.one_of(st.sampled_from([1, 2, 5, 60, 111, 200]), st.integers(1, 1500))
seeds = st.integers(0, 1000)
protocols = st.sampled_from(PROTOCOLS)
everies = st.integers(1, 10)


def runs(values: NDArray[np.bool_]) -> list[int]:
    """Lengths of the stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], values, [False]])))
    return (edges[1::2] - edges[::2]).tolist()


def legs(drive: Resampling) -> list[NDArray[np.int64]]:
    return np.split(drive.frames, drive.jumps)


@given(protocols, counts, everies, seeds)
def test_a_traverse_has_existing_frames_and_is_the_same_for_the_same_seed(
    protocol: Protocol, count: int, every: int, seed: int
) -> None:
    drive, again = (
        drive_of(protocol, count, foreign_count=FOREIGN, seed=seed, every=every) for _ in range(2)
    )

    assert len(drive.frames) == len(drive.foreign) == len(drive.repeated) >= 1
    assert drive.every == (every if protocol in THINS_REFERENCE else 1)
    assert not drive.repeated.any() or protocol in ("speed", "odometry")
    assert (drive.odometry is not None) == (protocol == "odometry")
    assert drive.odometry is None or np.array_equal(drive.odometry, again.odometry)
    assert (drive.frames >= 0).all()
    assert (drive.frames < np.where(drive.foreign, FOREIGN, count)).all()
    for one, other in (
        (drive.frames, again.frames),
        (drive.foreign, again.foreign),
        (drive.repeated, again.repeated),
        (drive.jumps, again.jumps),
    ):
        assert np.array_equal(one, other)
        assert one.dtype == other.dtype
    assert (drive.frames.dtype, drive.foreign.dtype, drive.jumps.dtype) == (int, bool, int)


@pytest.mark.parametrize("protocol", ["speed", "kidnap", "off-route"])
def test_another_seed_is_another_traverse(protocol: Protocol) -> None:
    one, other = (drive_of(protocol, 400, foreign_count=FOREIGN, seed=seed) for seed in (1, 2))
    assert one.frames.tolist() != other.frames.tolist()


def test_aligned_is_the_query_as_it_is() -> None:
    drive = drive_of("aligned", 5, foreign_count=0, seed=1)
    assert drive.frames.tolist() == [0, 1, 2, 3, 4]
    assert not drive.foreign.any()
    assert not len(drive.jumps)


@given(counts, everies, seeds)
def test_at_changing_speed_every_frame_is_new_unless_the_vehicle_is_stationary(
    count: int, every: int, seed: int
) -> None:
    drive = speed(count, every, seed)
    steps = np.diff(drive.frames)

    assert drive.every == every
    assert drive.frames[0] == 0
    assert count - 2 * every <= drive.frames[-1] < count
    assert not drive.repeated[0]
    assert (steps[drive.repeated[1:]] == 0).all()
    assert set(steps[~drive.repeated[1:]]) <= set(range(1, 2 * every + 1))
    assert max(runs(drive.repeated), default=1) <= 8


@pytest.mark.parametrize("every", [2, 3, 4])
def test_steps_are_log_uniform_from_one_query_frame_to_two_places_and_last_10_to_40_frames(
    every: int,
) -> None:
    drive = speed(400_000, every, seed=4)
    steps = np.diff(drive.frames)[~drive.repeated[1:]]
    # A step held for equally many frames: log-uniform over [1, 2n] has this mean, ...
    assert steps.mean() == pytest.approx((2 * every - 1) / np.log(2 * every), rel=0.03)
    # ... and half of its steps below the root of 2n, as a place is n frames.
    ten = np.convolve(steps, np.ones(10), "valid") / 10
    assert (ten < np.sqrt(2 * every)).mean() == pytest.approx(0.5, abs=0.04)
    assert ten.min() < 1.1
    assert ten.max() > 2 * every - 0.2

    # A stop of 1 to 8 frames comes before three in ten stretches, of 25 frames in the mean.
    stretches = 400_000 / (steps.mean() * 25)
    stops = runs(drive.repeated)
    assert len(stops) / stretches == pytest.approx(0.3, abs=0.03)
    assert np.mean(stops) == pytest.approx(4.5, abs=0.3)
    assert (min(stops), max(stops)) == (1, 8)


def test_between_stops_a_stretch_has_even_steps() -> None:
    """From a stop on, 10 frames at least go at one step: none is off it by a frame."""
    drive = speed(20_000, 4, seed=1)
    ends = np.flatnonzero(drive.repeated[:-1] & ~drive.repeated[1:])
    assert len(ends) > 30
    for end in ends[ends + 11 < len(drive.frames)]:
        way = drive.frames[end : end + 11] - drive.frames[end]
        possible = [
            step
            for step in np.geomspace(1, 8, 4000)
            if (np.abs(way - step * np.arange(11)) <= 1).all()
        ]
        assert possible


@given(counts, everies, seeds)
def test_with_odometry_a_traverse_is_the_same_and_has_readings_that_never_descend(
    count: int, every: int, seed: int
) -> None:
    drive, without = odometry(count, every, seed), speed(count, every, seed)
    assert drive.frames.tolist() == without.frames.tolist()
    assert drive.repeated.tolist() == without.repeated.tolist()
    assert drive.every == every
    assert drive.odometry is not None
    assert drive.odometry.shape == drive.frames.shape
    assert drive.odometry[0] == 0
    steps = np.diff(drive.odometry)
    assert (steps >= 0).all()
    assert (steps[drive.repeated[1:]] == 0).all()


def test_an_odometer_is_off_by_a_scale_of_5_percent_and_by_as_much_at_each_step() -> None:
    """A place of the thinned reference is 1 m."""
    scales, errors = [], []
    for seed in range(300):
        drive = odometry(2000, 4, seed)
        assert drive.odometry is not None
        ways = np.diff(drive.frames) / 4
        shares = np.diff(drive.odometry)[ways > 0] / ways[ways > 0]
        scales.append(shares.mean())
        errors.append((shares / shares.mean()).std())
    assert np.mean(scales) == pytest.approx(1, abs=0.01)
    assert np.std(scales) == pytest.approx(0.05, rel=0.15)
    assert np.mean(errors) == pytest.approx(0.05, rel=0.02)


def test_the_reference_is_thinned_to_every_4th_frame_for_speed_or_2nd_where_it_is_short() -> None:
    for protocol in ("speed", "odometry"):
        assert default_every(protocol, 400) == 4
        assert default_every(protocol, 399) == 2
    assert {default_every(p, n) for p in ("dense", "sparse") for n in (9, 900)} == {3}


@given(counts, everies)
def test_dense_has_all_frames_along_fewer_places_and_sparse_fewer_along_all(
    count: int, every: int
) -> None:
    dense, sparse = (
        drive_of(protocol, count, foreign_count=0, seed=0, every=every)
        for protocol in ("dense", "sparse")
    )
    assert (dense.frames.tolist(), dense.every) == (list(range(count)), every)
    assert (sparse.frames.tolist(), sparse.every) == (list(range(0, count, every)), 1)


@given(counts, seeds)
def test_a_kidnapped_traverse_is_aligned_between_its_jumps_and_about_as_long_as_the_query(
    count: int, seed: int
) -> None:
    drive = kidnap(count, seed)

    assert drive.frames[0] == 0
    assert all((np.diff(leg) == 1).all() for leg in legs(drive))
    assert count - 30 < len(drive.frames) <= count
    assert len(drive.jumps) >= (count >= 3)
    if count >= 180:
        lengths = [len(leg) for leg in legs(drive)]
        assert min(lengths) >= 30
        assert max(lengths) <= 120
        cut = [leg[-1] == count - 1 for leg in legs(drive)[:-1]]
        assert all(n >= 60 or end for n, end in zip(lengths[:-1], cut, strict=True))


def test_jumps_go_everywhere_where_enough_route_is_left() -> None:
    starts = [leg[0] for seed in range(400) for leg in legs(kidnap(300, seed))[1:]]
    assert max(starts) == 270
    shares, _ = np.histogram(starts, bins=9, range=(0, 271))
    assert shares / len(starts) == pytest.approx(np.full(9, 1 / 9), abs=0.04)


@given(counts, seeds)
def test_off_route_a_third_of_the_frames_are_foreign_and_the_query_is_complete(
    count: int, seed: int
) -> None:
    drive = off_route(count, FOREIGN, seed)
    foreign = drive.frames[drive.foreign]

    assert drive.frames[~drive.foreign].tolist() == list(range(count))
    assert len(foreign) == count // 2
    assert (np.diff(foreign) % FOREIGN == 1).all()
    if count > 1:
        assert not drive.foreign[[0, -1]].any()
    if count >= 60:
        assert all(30 <= length <= 90 for length in runs(drive.foreign))
        assert min(runs(~drive.foreign)) >= 14


def test_a_query_that_cannot_be_resampled_is_refused() -> None:
    with pytest.raises(ValueError, match="every 0"):
        drive_of("sparse", 60, foreign_count=0, seed=1, every=0)
    with pytest.raises(ValueError, match="other route has no frames"):
        drive_of("off-route", 60, foreign_count=0, seed=1)
    for protocol in PROTOCOLS:
        with pytest.raises(ValueError, match="query has no frames"):
            drive_of(protocol, 0, foreign_count=9, seed=1)


def test_recovery_is_counted_to_the_first_right_match_and_no_further_than_the_next_jump() -> None:
    correct = np.array([1, 1, 0, 0, 1, 0, 0, 0, 1, 1, 0, 0], bool)

    assert frames_to_recover(np.array([2, 5, 8, 10]), correct).tolist() == [2, 3, 0, 2]
    assert frames_to_recover(np.array([], int), correct).tolist() == []


def test_in_reverse_every_frame_comes_once_the_last_one_first() -> None:
    drive = drive_of("reverse", 5, foreign_count=0, seed=0)
    assert drive.frames.tolist() == [4, 3, 2, 1, 0]
    assert not drive.foreign.any()
    assert not len(drive.jumps)
