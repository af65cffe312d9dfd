from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.evaluation.protocols import (
    Drive,
    Protocol,
    drive_of,
    frames_to_recover,
    kidnap,
    off_route,
    speed,
)

PROTOCOLS: tuple[Protocol, ...] = get_args(Protocol)
FOREIGN = 50

counts = st.one_of(st.sampled_from([1, 2, 5, 60, 111, 200]), st.integers(1, 1500))
seeds = st.integers(0, 1000)
protocols = st.sampled_from(PROTOCOLS)


def runs(values: NDArray[np.bool_]) -> list[int]:
    """Lengths of the stretches of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], values, [False]])))
    return (edges[1::2] - edges[::2]).tolist()


def legs(drive: Drive) -> list[NDArray[np.int64]]:
    return np.split(drive.frames, drive.jumps)


@given(protocols, counts, seeds)
def test_a_drive_takes_frames_that_are_there_and_is_the_same_for_the_same_seed(
    protocol: Protocol, count: int, seed: int
) -> None:
    drive, again = (drive_of(protocol, count, foreign_count=FOREIGN, seed=seed) for _ in range(2))

    assert len(drive.frames) == len(drive.foreign) >= 1
    assert (drive.frames >= 0).all()
    assert (drive.frames < np.where(drive.foreign, FOREIGN, count)).all()
    for one, other in (
        (drive.frames, again.frames),
        (drive.foreign, again.foreign),
        (drive.jumps, again.jumps),
    ):
        assert np.array_equal(one, other)
        assert one.dtype == other.dtype
    assert (drive.frames.dtype, drive.foreign.dtype, drive.jumps.dtype) == (int, bool, int)


@pytest.mark.parametrize("protocol", ["speed", "kidnap", "off-route"])
def test_another_seed_is_another_drive(protocol: Protocol) -> None:
    one, other = (drive_of(protocol, 400, foreign_count=FOREIGN, seed=seed) for seed in (1, 2))
    assert one.frames.tolist() != other.frames.tolist()


def test_aligned_is_the_query_as_it_is() -> None:
    drive = drive_of("aligned", 5, foreign_count=0, seed=1)
    assert drive.frames.tolist() == [0, 1, 2, 3, 4]
    assert not drive.foreign.any()
    assert not len(drive.jumps)


@given(counts, seeds)
def test_a_drive_at_changing_speed_goes_through_the_query_from_its_beginning_to_its_end(
    count: int, seed: int
) -> None:
    frames = speed(count, seed).frames
    assert frames[0] == 0
    assert count - 3 < frames[-1] < count
    # At double speed, rounding makes no step of 3.
    assert set(np.diff(frames)) <= {0, 1, 2}


def test_speeds_are_log_uniform_from_half_to_double_in_stretches_and_stops_are_as_told() -> None:
    steps = np.diff(speed(200_000, seed=4).frames)

    # Log-uniform speed v held for equally many frames has the mean 1.5 / ln 4 = 1.08.
    stops = [length for length in runs(steps == 0) if length > 1]
    moving = len(steps) - sum(stops)
    assert 200_000 / moving == pytest.approx(1.5 / np.log(4), abs=0.02)
    # A stop of n stands n steps; a slow stretch may stand one more before and after it.
    assert max(stops) in (8, 9, 10)
    # 3 in 10 stretches of 25 frames have a stop, and 7 in 8 of these are longer than one frame.
    assert len(stops) / (moving / 25) == pytest.approx(0.3 * 7 / 8, abs=0.04)
    # At a constant speed of v, 10 successive frames go 10 v, from 5 to 20.
    ten = np.convolve(steps, np.ones(10), "valid")
    assert ten.max() == 20


@given(counts, seeds)
def test_a_kidnapped_drive_is_aligned_between_its_jumps_and_about_as_long_as_the_query(
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
def test_off_route_a_third_of_the_frames_are_foreign_and_the_query_is_driven_whole(
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


def test_what_cannot_be_driven_is_refused() -> None:
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
