import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.scales.channels import make_channels
from placefield.scales.placed import with_route_position
from placefield.scales.subtractive import PLACED, UNPLACED, estimate_clusters


def looks_at_random(frames: int = 200) -> NDArray[np.float32]:
    """Of ten frames each."""
    rng = np.random.default_rng(0)
    views = np.repeat(rng.normal(size=(frames // 10, 30)), 10, axis=0)
    return (views + 0.5 * rng.normal(size=(frames, 30))).astype(np.float32)


def test_fuzzifiers_go_evenly_from_1_02_to_1_4() -> None:
    channels = make_channels(looks_at_random(), channels=3, min_scale=2, seed=0)
    assert [channel.fuzzifier for channel in channels] == pytest.approx([1.02, 1.21, 1.4])


def test_the_first_and_the_last_fuzzifier_may_be_others() -> None:
    channels = make_channels(
        looks_at_random(), channels=3, min_scale=2, seed=0, fuzzifiers=(1.1, 1.3)
    )
    assert [channel.fuzzifier for channel in channels] == pytest.approx([1.1, 1.2, 1.3])


@pytest.mark.parametrize("same_start", [True, False])
def test_from_the_same_start_channels_of_one_fuzzifier_are_equal(same_start: bool) -> None:
    first, second = make_channels(
        looks_at_random(),
        channels=2,
        min_scale=2,
        seed=5,
        clusters=13,
        fuzzifiers=(1.1, 1.1),
        same_start=same_start,
    )
    assert np.array_equal(first.clusters, second.clusters) == same_start


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0, 3.0])
def test_the_number_of_clusters_is_estimated_at_weight_1_or_without_position_where_it_has_none(
    weight: float,
) -> None:
    vectors = looks_at_random()
    placed = estimate_clusters(with_route_position(vectors, 1.0), PLACED)
    unplaced = estimate_clusters(with_route_position(vectors, 0), UNPLACED)
    estimate = placed if weight else unplaced
    assert weight or estimate != placed

    def labels(clusters: int | None) -> NDArray[np.int32]:
        (channel,) = make_channels(
            vectors,
            channels=1,
            min_scale=2,
            seed=0,
            clusters=clusters,
            position_weight=weight,
        )
        return channel.clusters

    np.testing.assert_array_equal(labels(clusters=None), labels(clusters=estimate))
