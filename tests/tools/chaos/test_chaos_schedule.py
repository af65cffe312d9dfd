"""Schedules of faults."""

from collections import Counter
from itertools import combinations, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from placefield.errors import ConfigError
from placefield_tools.chaos.schedule import APART, KINDS, schedule


@given(st.integers(0, 2**32), st.integers(0, 30), st.integers(0, 5000))
def test_faults_are_apart_in_order_and_within_the_stream(
    seed: int, faults: int, spare: int
) -> None:
    frames = (faults + 1) * APART + spare
    drawn = schedule(seed, frames, faults)
    assert len(drawn) == faults
    assert drawn == schedule(seed, frames, faults)
    starts = [fault.at for fault in drawn]
    assert all(later - earlier >= APART - 10 for earlier, later in pairwise(starts))
    assert all(fault.at <= fault.end < min(fault.at + APART, frames) for fault in drawn)


@given(st.integers(0, 2**32), st.integers(2, 30), st.integers(0, 5000))
def test_the_first_and_the_last_frames_have_a_fault(seed: int, faults: int, spare: int) -> None:
    frames = (faults + 1) * APART + spare
    first, *_, last = schedule(seed, frames, faults)
    assert 1 <= first.at <= 10
    assert not first.is_last
    assert frames - 10 <= last.at < frames
    assert last.is_last


def test_services_are_killed_alone_in_pairs_and_all_at_once() -> None:
    killed = {
        frozenset(kind.removeprefix("kill ").split(" and ")) for kind in KINDS if "kill" in kind
    }
    three = {"channel", "featurizer", "fuser"}
    sets = {frozenset(some) for n in (1, 2, 3) for some in combinations(three, n)}
    assert killed == sets | {frozenset({"router"})}


@given(st.integers(0, 2**32), st.integers(0, 30))
def test_each_kind_comes_before_any_comes_again(seed: int, faults: int) -> None:
    counts = Counter(fault.kind for fault in schedule(seed, (faults + 1) * APART, faults))
    times = [counts[kind] for kind in KINDS]
    assert max(times) - min(times) <= 1


def test_another_seed_gives_another_schedule() -> None:
    assert schedule(1, 1000, 7) != schedule(2, 1000, 7)


def test_a_stream_too_short_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"^--frames 479: too few for 7 faults; give 480"):
        schedule(0, 479, 7)
