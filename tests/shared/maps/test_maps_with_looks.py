"""Maps of several traverses that keep each one's looks of the places."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import MapError
from placefield.maps.build import build_map
from placefield.maps.checksums import checksum_of
from placefield.maps.manifest import MANIFEST, SEAL, seal_of
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.maps.traverse import Alignment, Traverse
from placefield.matching.comparing import MetricPlaces

MakeTraverse = Callable[..., Traverse]
SHOWN = np.r_[20:60, np.full(5, -1), 60:80].astype(np.int32)
LOOKED = [*[20] * 3, *range(20, 80), *[79] * 3]
"""The place of the frame that is the look of each place from 17 to 82."""


def map_of(make_traverse: MakeTraverse, *, looks: bool = True, coarse_from: int = 1000) -> Map:
    night = make_traverse(len(SHOWN), name="night", noise=1)
    aligned = replace(
        night, alignment=Alignment(SHOWN, np.ones(len(SHOWN), np.float32), "smoother")
    )
    config = Config.model_validate(
        {
            "metric": {"kind": "identity"},
            "scales": {"channels": 2},
            "build": {"looks": looks, "coarse_from": coarse_from},
        }
    )
    return build_map([make_traverse(), aligned], config)


@pytest.fixture
def built(make_traverse: MakeTraverse) -> Map:
    return map_of(make_traverse)


def seal(path: Path, **metric: object) -> None:
    """Give all files their checksums, and the first metric other values in the manifest."""
    manifest = json.loads((path / MANIFEST).read_text())
    manifest["metrics"][0] |= metric
    for file in path.rglob("*.npy"):
        manifest["files"][str(file.relative_to(path))] = checksum_of(file)
    written = json.dumps(manifest).encode()
    (path / MANIFEST).write_bytes(written)
    (path / SEAL).write_bytes(seal_of(written))


def test_aligned_frames_are_looks_of_their_places_and_of_near_ones_without_a_frame(
    make_traverse: MakeTraverse,
) -> None:
    built = map_of(make_traverse)
    looks = built.metrics[0].looks
    assert looks is not None
    assert looks.places.tolist() == list(range(17, 83))
    assert looks.traverses is not None
    assert looks.traverses.tolist() == [1] * 66
    raw = make_traverse(len(SHOWN), name="night", noise=1).raw[SHOWN >= 0]
    units = raw / np.linalg.norm(raw, axis=1, keepdims=True)
    standardised = (units - units.mean(axis=0)) / units.std(axis=0)
    observed = standardised @ built.model.components.T
    observed /= np.linalg.norm(observed, axis=1, keepdims=True)
    expected = observed[np.array(LOOKED) - 20]
    np.testing.assert_allclose(looks.descriptors / 4000, expected, atol=3e-4)
    compared = MetricPlaces(built.metrics[0], exact=True).compare(observed.astype(np.float32))
    found = [int(frame.distances.argmin()) for frame in compared]
    assert found[1:-1] == list(range(21, 79))
    assert found[0] in range(17, 21)
    assert found[-1] in range(79, 83)


def test_a_place_between_two_frames_has_the_look_of_the_nearest(
    make_traverse: MakeTraverse,
) -> None:
    shown = np.r_[0:40:2, 40:80:10].astype(np.int32)[::-1].copy()
    night = make_traverse(len(shown), name="night", noise=1)
    aligned = replace(
        night, alignment=Alignment(shown, np.ones(len(shown), np.float32), "smoother")
    )
    config = Config.model_validate(
        {"metric": {"kind": "identity"}, "scales": {"channels": 2}, "build": {"looks": True}}
    )
    looks = build_map([make_traverse(), aligned], config).metrics[0].looks
    assert looks is not None
    near = {place: int(np.abs(shown - place).min()) for place in range(90)}
    assert looks.places.tolist() == [place for place, apart in near.items() if apart <= 3]
    own = dict(zip(looks.places.tolist(), looks.descriptors.tolist(), strict=True))
    for place, descriptor in own.items():
        ties = [other for other in shown.tolist() if abs(other - place) == near[place]]
        assert descriptor == own[min(ties)]


def test_without_the_setting_or_with_one_traverse_there_are_none(
    make_traverse: MakeTraverse, small_map: Map
) -> None:
    assert not Config().build.looks
    assert map_of(make_traverse, looks=False).metrics[0].looks is None
    assert small_map.metrics[0].looks is None


@pytest.mark.parametrize("coarse_from", [1, 1000])
def test_looks_come_back_from_disk(
    make_traverse: MakeTraverse, tmp_path: Path, coarse_from: int
) -> None:
    path = tmp_path / "route.pfmap"
    built = map_of(make_traverse, coarse_from=coarse_from)
    save_map(built, path)
    saved, opened = built.metrics[0].looks, open_map(path).metrics[0].looks
    assert saved is not None
    assert opened is not None
    assert (saved.codes is None) == (coarse_from == 1000)
    for name in ("places", "descriptors", "squares", "biases", "codes", "traverses"):
        one, other = getattr(saved, name), getattr(opened, name)
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_array_equal(one, other)


def test_a_map_from_before_there_were_looks_opens(saved: Path) -> None:
    manifest = json.loads((saved / MANIFEST).read_text())
    for metric in manifest["metrics"]:
        assert metric.pop("looks") == 0
    written = json.dumps(manifest).encode()
    (saved / MANIFEST).write_bytes(written)
    (saved / SEAL).write_bytes(seal_of(written))
    assert open_map(saved).metrics[0].looks is None


def test_a_map_whose_looks_are_of_no_known_traverse_opens(built: Map, tmp_path: Path) -> None:
    path = tmp_path / "route.pfmap"
    save_map(built, path)
    manifest = json.loads((path / MANIFEST).read_text())
    assert manifest["files"].pop("metrics/0/looks/traverses.npy")
    (path / "metrics" / "0" / "looks" / "traverses.npy").unlink()
    written = json.dumps(manifest).encode()
    (path / MANIFEST).write_bytes(written)
    (path / SEAL).write_bytes(seal_of(written))
    looks = open_map(path).metrics[0].looks
    assert looks is not None
    assert looks.traverses is None


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("places", lambda known: known[::-1]),
        ("places", lambda known: known - 18),
        ("places", lambda known: known + 8),
        ("places", lambda known: np.where(known == 82, 2**31 - 1, known).astype(np.int32)),
        ("places", lambda known: known[:-1]),
        ("places", lambda known: known[:0]),
        ("places", lambda known: known.astype(np.int64)),
        ("descriptors", lambda known: known[:, :-1]),
        ("descriptors", lambda known: known[:-1]),
        ("descriptors", lambda known: known.astype(np.float32)),
        ("squares", lambda known: known[:-1]),
        ("biases", lambda known: known[:-1]),
        ("biases", lambda known: known - 1),
        ("biases", lambda known: known + 2**27),
        ("traverses", lambda known: known[:-1]),
        ("traverses", lambda known: known - 1),
        ("traverses", lambda known: known + 1),
    ],
)
def test_looks_that_do_not_fit_the_map_are_refused(
    built: Map, tmp_path: Path, name: str, wrong: Callable[[NDArray[np.int32]], NDArray[np.int32]]
) -> None:
    path = tmp_path / "route.pfmap"
    save_map(built, path)
    file = path / "metrics" / "0" / "looks" / f"{name}.npy"
    np.save(file, np.ascontiguousarray(wrong(np.load(file))))
    seal(path)
    with pytest.raises(MapError) as refused:
        open_map(path)
    assert str(file) in str(refused.value)


@pytest.mark.parametrize("looks", [-1, 65, 67, 10**15, 1.5, "many"])
def test_another_number_of_looks_in_the_manifest_is_refused(
    built: Map, tmp_path: Path, looks: object
) -> None:
    path = tmp_path / "route.pfmap"
    save_map(built, path)
    seal(path, looks=looks)
    with pytest.raises(MapError):
        open_map(path)
