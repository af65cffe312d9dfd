from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from placefield_tools.up.service_commands import partition


def test_channels_of_one_metric_go_to_one_worker() -> None:
    assert partition("aabb", 2) == [[0, 1], [2, 3]]
    assert partition("abab", 2) == [[0, 2], [1, 3]]
    assert partition("abba", 2) == [[0, 3], [1, 2]]
    assert partition("aaaa", 2) == [[0, 1], [2, 3]]


@given(st.text("abc", min_size=1, max_size=12), st.integers(1, 9))
def test_every_channel_is_in_one_part_and_parts_are_even(metrics: str, workers: int) -> None:
    parts = partition(metrics, workers)
    assert sorted(channel for own in parts for channel in own) == list(range(len(metrics)))
    assert len(parts) == min(workers, len(metrics))
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    shared = [{metrics[channel] for channel in own} for own in parts]
    assert all(len(one & next_) <= 1 for one, next_ in pairwise(shared))
