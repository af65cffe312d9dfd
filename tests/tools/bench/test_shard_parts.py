"""The parts of a frame in shards, on a map small enough for a test."""

from placefield_tools.bench.figure import as_object
from placefield_tools.bench.random_walks import observed_again, random_walk
from placefield_tools.bench.shard_parts import SHARDS, shard_parts
from placefield_tools.bench.synthetic import made_channel


def test_each_part_is_timed_for_each_number_of_shards() -> None:
    walk = random_walk(1200, 40, seed=0)
    query = list(observed_again(walk[100:115], 0.5, seed=1))
    figures = as_object(shard_parts(made_channel(walk, 0), query))
    assert set(figures) == {
        f"shard_{part}_ms_{shards}" for part in ("local", "reduce", "halo") for shards in SHARDS
    }
    assert all(value > 0 for value in figures.values())
