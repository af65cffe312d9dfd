import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.scales.channels import make_channels
from placefield.scales.clustering import with_route_position
from placefield.scales.subtractive import estimate_clusters


def looks_at_random(frames: int = 200) -> NDArray[np.float32]:
    """Of ten frames each."""
    rng = np.random.default_rng(0)
    looks = np.repeat(rng.normal(size=(frames // 10, 30)), 10, axis=0)
    return (looks + 0.5 * rng.normal(size=(frames, 30))).astype(np.float32)


def test_fuzzifiers_go_evenly_from_1_02_to_1_4() -> None:
    channels = make_channels(looks_at_random(), channels=3, min_scale=2, seed=0)
    assert [channel.fuzzifier for channel in channels] == pytest.approx([1.02, 1.21, 1.4])


@pytest.mark.parametrize("weight", [0.0, 1.0, 3.0])
def test_the_number_of_clusters_is_estimated_at_position_weight_1_whatever_that_of_the_clustering(
    weight: float,
) -> None:
    vectors = looks_at_random()
    estimate = estimate_clusters(with_route_position(vectors, 1.0))
    assert weight == 1 or estimate != estimate_clusters(with_route_position(vectors, weight))

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
