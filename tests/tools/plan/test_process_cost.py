from dataclasses import replace
from pathlib import Path

import pytest

from placefield.errors import MapError
from placefield.maps.manifest import read_manifest
from placefield_tools.plan.process_cost import MetricLoad, loads_of, services_of, worker_of


def test_loads_are_read_off_the_manifest_and_the_sizes_of_files(map_path: Path) -> None:
    manifest = read_manifest(map_path)
    sizes = {name: (map_path / name).stat().st_size for name in manifest.files}
    [load] = loads_of(manifest, sizes)
    assert load.channels == (0, 1, 2)
    assert load.read_bytes == (map_path / "metrics/0/places.npy").stat().st_size
    assert load.projected_bytes == 0  # nothing was learned
    metric = sum(file.stat().st_size for file in (map_path / "metrics/0").rglob("*.npy"))
    assert load.mapped_bytes == metric
    assert [service.service for service in services_of(manifest)] == ["featurizer", "fuser"]


def test_a_coarse_look_reads_a_fraction(map_path: Path) -> None:
    manifest = read_manifest(map_path)
    record = manifest.metrics[0].model_copy(update={"coarse_unit": 1.0, "learned": True})
    coarse = manifest.model_copy(update={"metrics": (record,)})
    sizes = {"places": 64_000, "squares": 400, "steps": 800, "projection": 5000}
    named = {f"metrics/0/{name}.npy": size for name, size in sizes.items()}
    looks = {"codes": 6400, "axes": 700, "spread": 90}
    named |= {f"metrics/0/coarse/{name}.npy": size for name, size in looks.items()}
    [load] = loads_of(coarse, named)
    assert load.read_bytes == 6400 + 1000
    assert load.projected_bytes == 5700
    assert load.mapped_bytes == sum(named.values())
    assert not load.has_lists
    lists = ("centroids", "ends", "places", "codes", "squares")
    listed = named | {f"metrics/0/coarse/lists/{name}.npy": 1000 for name in lists}
    [load] = loads_of(coarse, listed)
    assert load.has_lists
    assert load.mapped_bytes == sum(listed.values())
    with pytest.raises(MapError, match=r"metrics/0/coarse/axes\.npy: not in the manifest"):
        loads_of(coarse, {name: size for name, size in named.items() if "axes" not in name})


def test_looks_are_read_like_places(map_path: Path) -> None:
    manifest = read_manifest(map_path)
    sizes = {"places": 64_000, "squares": 400, "steps": 800, "projection": 5000}
    coarse = {"codes": 6400, "axes": 700, "spread": 90}
    looks = {"places": 40, "descriptors": 6400, "squares": 40, "biases": 400, "codes": 640}
    named = {f"metrics/0/{name}.npy": size for name, size in sizes.items()}
    named |= {f"metrics/0/coarse/{name}.npy": size for name, size in coarse.items()}
    named |= {f"metrics/0/looks/{name}.npy": size for name, size in looks.items()}
    for unit, read in ((None, 64_000 + 6400), (1.0, 6400 + 640 + 1100)):
        record = manifest.metrics[0].model_copy(update={"coarse_unit": unit, "looks": 10})
        [load] = loads_of(manifest.model_copy(update={"metrics": (record,)}), named)
        assert load.read_bytes == read
    assert load.mapped_bytes == sum(named.values())


def test_channels_of_one_metric_cost_no_more_than_one_of_them() -> None:
    one = MetricLoad((0,), 60_000_000, 360_000, 61_200_000)
    shared = replace(one, channels=(0, 1, 2, 3))
    assert replace(worker_of([shared], 1, 100_000), channels=(0,)) == worker_of([one], 1, 100_000)
