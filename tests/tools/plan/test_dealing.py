from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from placefield_tools.cli.up import deal


def test_channels_of_one_metric_go_to_one_worker() -> None:
    assert deal("aabb", 2) == [[0, 1], [2, 3]]
    assert deal("abab", 2) == [[0, 2], [1, 3]]
    assert deal("abba", 2) == [[0, 3], [1, 2]]
    assert deal("aaaa", 2) == [[0, 1], [2, 3]]


@given(st.text("abc", min_size=1, max_size=12), st.integers(1, 9))
def test_every_channel_is_dealt_once_and_as_evenly_as_it_goes(metrics: str, workers: int) -> None:
    dealt = deal(metrics, workers)
    assert sorted(channel for own in dealt for channel in own) == list(range(len(metrics)))
    assert len(dealt) == min(workers, len(metrics))
    assert max(map(len, dealt)) - min(map(len, dealt)) <= 1
    shared = [{metrics[channel] for channel in own} for own in dealt]
    assert all(len(one & next_) <= 1 for one, next_ in pairwise(shared))
