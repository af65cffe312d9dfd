import tracemalloc

import numpy as np
from numpy.typing import NDArray

from placefield.baselines.multiscale import fixed_scale_channels
from placefield.config import Config
from placefield.maps.build import build_map
from placefield.maps.map import Map
from placefield.maps.traverse import Traverse


def traverse_of(raw: NDArray[np.float32]) -> Traverse:
    return Traverse(
        "made-up", raw, np.arange(len(raw)), np.empty((0, 3)), np.empty(0), (b"",) * len(raw)
    )


def test_a_metric_of_two_traverses_is_learned_in_little_more_than_they_take() -> None:
    """Once more for what is learned on, once for what is learned, a block of distances beside."""
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.normal(size=(2000, 200)), axis=0)
    raws = [(walk + rng.normal(size=walk.shape)).astype(np.float32) for _ in range(2)]
    config = Config.model_validate({"metric": {"steps": 1}})

    def build(references: list[Traverse]) -> Map:
        cut = fixed_scale_channels(len(references[0].raw), [20])
        return build_map(references, config, cut=lambda *_: cut)

    build([traverse_of(raw[:100]) for raw in raws])  # all is compiled
    traverses = [traverse_of(raw) for raw in raws]
    tracemalloc.start()
    try:
        placemap = build(traverses)
        added = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    features = sum(raw.nbytes for raw in raws)
    descriptors = 4 * 2 * len(walk) * len(placemap.model.components)
    assert features + added <= 3 * (features + descriptors)
