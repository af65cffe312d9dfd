import errno
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from networks import write_network
from numpy.typing import NDArray

from placefield.config import Config
from placefield.errors import MapError
from placefield.features.extract import feature_of_model
from placefield.features.network import read_network
from placefield.maps import store
from placefield.maps.build import build_map
from placefield.maps.manifest import MANIFEST, SEAL, check_map_path, seal_of
from placefield.maps.map import Map, MapAlignment, fingerprint
from placefield.maps.map_metrics import identity_metric, learned_metric
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.maps.traverse import Alignment, Traverse


def assert_same(one: Any, other: Any) -> None:
    """Assert that two values are equal, arrays bit for bit."""
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes()
    elif is_dataclass(one):
        for field in filter(lambda field: field.compare, fields(one)):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, tuple):
        for left, right in zip(one, other, strict=True):
            assert_same(left, right)
    else:
        assert one == other


def arrays_of(value: Any) -> Iterator[NDArray[Any]]:
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from arrays_of(item)
    elif is_dataclass(value):
        for field in fields(value):
            yield from arrays_of(getattr(value, field.name))


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file()
    }


def test_a_map_comes_back_as_it_was_and_read_only(pristine: Path, posed_map: Map) -> None:
    opened = open_map(pristine)
    assert_same(posed_map, opened)
    arrays = list(arrays_of(opened))
    assert len(arrays) == 3 + 6 + 2 + 4 + 2 * (4 + 4)
    for array in arrays:
        assert not array.flags.writeable


def test_a_map_without_poses_and_odometry_comes_back(small_map: Map, tmp_path: Path) -> None:
    assert not len(small_map.places.travelled)
    save_map(small_map, tmp_path / "route.pfmap")
    assert_same(small_map, open_map(tmp_path / "route.pfmap"))


def test_how_traverses_were_aligned_and_why_no_metric_was_kept_come_back(
    make_traverse: Callable[..., Traverse], tmp_path: Path
) -> None:
    config = Config.model_validate({"scales": {"channels": 2}, "metric": {"gate": True}})
    places = np.arange(80, dtype=np.int32) - 1
    shorter = replace(
        make_traverse(80), alignment=Alignment(places, np.ones(80, np.float32), "poses")
    )
    built = build_map([make_traverse(90), make_traverse(90, noise=1), shorter], config)
    assert [(each.aligned, each.by) for each in built.traverses] == [
        (None, None),
        (90, "number"),
        (79, "poses"),
    ]
    save_map(built, tmp_path / "route.pfmap")
    opened = open_map(tmp_path / "route.pfmap")
    assert_same(built.traverses, opened.traverses)
    assert list(opened.alignments) == [1, 2]
    for number, expected in ((1, np.arange(90)), (2, places)):
        np.testing.assert_array_equal(opened.alignments[number].places, expected)
    reasons = [channel.refusal for channel in built.channels]
    assert [channel.refusal for channel in opened.channels] == reasons
    for channel in opened.channels:
        assert bool(channel.refusal) != channel.metric.learned


@pytest.mark.parametrize("wrong", [-2, 90])
def test_an_alignment_to_no_place_of_the_map_is_refused(
    make_traverse: Callable[..., Traverse], tmp_path: Path, wrong: int
) -> None:
    config = Config.model_validate({"scales": {"channels": 2}, "metric": {"kind": "identity"}})
    built = build_map([make_traverse(90), make_traverse(90, noise=1)], config)
    places = built.alignments[1].places.copy()
    places[7] = wrong
    damaged = replace(built, alignments={1: MapAlignment(places)})
    save_map(damaged, tmp_path / "route.pfmap")
    with pytest.raises(MapError, match=r"traverses/1/places\.npy: does not fit the map"):
        open_map(tmp_path / "route.pfmap")


@pytest.mark.parametrize("coarse", [False, True])
def test_metrics_come_back_and_channels_that_shared_one_share_it(
    posed_map: Map, tmp_path: Path, coarse: bool
) -> None:
    first, other = posed_map.channels
    descriptors = (first.metric.unit * first.metric.places).astype(np.float32)
    projection = np.random.default_rng(1).normal(size=(12, 30)).astype(np.float32)
    learned = learned_metric(projection, descriptors, coarse=coarse)
    shared = identity_metric(descriptors, coarse=coarse)
    metrics = (shared, learned, shared)
    channels = zip((first, other, other), metrics, strict=True)
    changed = tuple(replace(channel, metric=metric) for channel, metric in channels)
    built = replace(posed_map, channels=changed, identity=shared)
    save_map(built, tmp_path / "route.pfmap")
    opened = open_map(tmp_path / "route.pfmap")
    assert_same(built, opened)
    assert opened.identity is opened.channels[0].metric
    one, two, three = (channel.metric for channel in opened.channels)
    assert one is three
    assert opened.metrics == (one, two)
    assert [metric.learned for metric in opened.metrics] == [False, True]
    assert [metric.coarse is not None for metric in opened.metrics] == [coarse, coarse]
    assert len(list((tmp_path / "route.pfmap" / "metrics").iterdir())) == 2


def test_a_map_of_an_earlier_version_has_an_index_without_lists(
    posed_map: Map, tmp_path: Path
) -> None:
    channel = posed_map.channels[0]
    descriptors = (channel.metric.unit * channel.metric.places).astype(np.float32)
    metric = identity_metric(descriptors, coarse=True)
    assert metric.coarse is not None
    older = replace(metric, coarse=replace(metric.coarse, lists=None))
    changed = tuple(replace(each, metric=older) for each in posed_map.channels)
    save_map(replace(posed_map, channels=changed, identity=older), tmp_path / "route.pfmap")
    coarse = open_map(tmp_path / "route.pfmap").metrics[0].coarse
    assert coarse is not None
    assert coarse.lists is None
    np.testing.assert_array_equal(coarse.codes, metric.coarse.codes)


def test_a_map_whose_channels_all_learned_a_metric_keeps_the_identity_first(
    posed_map: Map, tmp_path: Path
) -> None:
    identity = posed_map.identity
    assert identity is not None
    learned = learned_metric(
        2 * identity.projection, (identity.unit * identity.places).astype(np.float32)
    )
    channels = tuple(replace(channel, metric=learned) for channel in posed_map.channels)
    save_map(replace(posed_map, channels=channels), tmp_path / "route.pfmap")
    opened = open_map(tmp_path / "route.pfmap")
    assert [metric.learned for metric in opened.metrics] == [False, True]
    assert opened.identity is opened.metrics[0]
    np.testing.assert_array_equal(opened.metrics[0].places, identity.places)
    assert open_map(tmp_path / "route.pfmap", channels=()).identity is None
    save_map(replace(posed_map, channels=channels, identity=None), tmp_path / "older.pfmap")
    older = open_map(tmp_path / "older.pfmap")
    assert older.identity is None
    assert [metric.learned for metric in older.metrics] == [True]


def test_a_map_keeps_its_network_and_is_another_under_another(
    small_map: Map, tmp_path: Path
) -> None:
    path = tmp_path / "route.pfmap"
    fingerprints = {fingerprint(small_map.model)}
    for declared in ({}, {"grid": 2}):
        write_network(tmp_path / "net.onnx", **declared)
        network = read_network(tmp_path / "net.onnx")
        features = small_map.features.model_copy(update={"kind": "onnx:net.onnx"})
        model = replace(small_map.model, kind=features.kind, network=network)
        save_map(replace(small_map, features=features, model=model), path)
        (tmp_path / "net.onnx").unlink()
        (tmp_path / "net.toml").unlink()
        opened = open_map(path).model
        assert opened.network is not None
        assert opened.network.input == network.input
        assert opened.network.onnx.tobytes() == network.onnx.tobytes()
        fingerprints.add(fingerprint(opened))
    assert len(fingerprints) == 3


def test_a_map_keeps_how_its_images_are_decoded_and_one_without_it_decodes_them_whole(
    saved: Path, small_map: Map
) -> None:
    model = replace(small_map.model, kind="gist", least_side=256)
    features = small_map.features.model_copy(update={"kind": "gist"})
    save_map(replace(small_map, model=model, features=features), saved)
    assert feature_of_model(open_map(saved).model).least_side == 256

    whole = replace(model, least_side=None)
    manifest = json.loads((saved / MANIFEST).read_bytes())
    del manifest["least_side"]  # as an earlier version wrote it
    manifest["model"] = fingerprint(whole)
    assert manifest["model"] != fingerprint(model)
    (saved / MANIFEST).write_text(json.dumps(manifest))
    (saved / SEAL).write_bytes(seal_of((saved / MANIFEST).read_bytes()))
    image = np.random.default_rng(0).integers(0, 256, (512, 512, 3), np.uint8)
    jpeg = cv2.imencode(".jpg", image)[1]
    pixels = np.asarray(cv2.imdecode(jpeg, cv2.IMREAD_COLOR), np.uint8)
    feature = feature_of_model(open_map(saved).model)
    np.testing.assert_array_equal(feature.describe(jpeg.tobytes()), feature.describe(pixels))


def test_the_same_frames_make_the_same_bytes(
    pristine: Path,
    make_map: Callable[[Traverse], Map],
    make_traverse: Callable[..., Traverse],
    tmp_path: Path,
) -> None:
    save_map(make_map(make_traverse(spacing=0.5)), tmp_path / "again.pfmap")
    assert files_of(tmp_path / "again.pfmap") == files_of(pristine)


def test_every_array_loads_without_pickle(pristine: Path) -> None:
    for file in pristine.rglob("*.npy"):
        np.load(file, allow_pickle=False)


def test_a_map_is_replaced_by_a_newer_one(saved: Path, small_map: Map) -> None:
    older = open_map(saved)
    stamps = older.places.stamps.copy()
    save_map(small_map, saved)
    assert_same(small_map, open_map(saved))
    assert os.listdir(saved.parent) == [saved.name]
    np.testing.assert_array_equal(older.places.stamps, stamps)


def test_a_map_that_is_replaced_is_missing_at_no_instant(saved: Path, small_map: Map) -> None:
    is_over, missing = threading.Event(), 0

    def look() -> None:
        nonlocal missing
        while not is_over.is_set():
            missing += not saved.exists()

    looking = threading.Thread(target=look)
    looking.start()
    for _ in range(20):
        save_map(small_map, saved)
    is_over.set()
    looking.join()
    assert not missing


def test_where_a_system_cannot_exchange_folders_a_map_is_replaced_by_renaming(
    saved: Path, small_map: Map, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(one: Path, other: Path) -> None:
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    monkeypatch.setattr(store, "exchange", refuse)
    save_map(replace(small_map, seed=small_map.seed + 1), saved)
    assert open_map(saved).seed == small_map.seed + 1
    assert os.listdir(saved.parent) == [saved.name]


def test_only_a_map_is_replaced(small_map: Map, tmp_path: Path) -> None:
    folder, file = tmp_path / "photos.pfmap", tmp_path / "file.pfmap"
    folder.mkdir()
    (folder / "photo.jpg").touch()
    file.write_text("no map")
    for path, complaint in [
        (tmp_path / "route", "ends in .pfmap"),
        (tmp_path / ".pfmap", "ends in .pfmap"),
        (folder, "is no map"),
        (file, "is no map"),
    ]:
        for refuse in (check_map_path, lambda path: save_map(small_map, path)):
            with pytest.raises(MapError, match=f"{re.escape(str(path))}: .*{complaint}"):
                refuse(path)
    assert files_of(tmp_path) == {"photos.pfmap/photo.jpg": b"", "file.pfmap": b"no map"}


def full_disk(*_: Any, **__: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def fail_at_array(number: int, patch: pytest.MonkeyPatch) -> None:
    saves = [np.save] * number + [full_disk]
    patch.setattr(np, "save", lambda *args, **options: saves.pop(0)(*args, **options))


def fail_at_manifest(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(os, "fsync", full_disk)


@pytest.mark.parametrize(
    "fail",
    [partial(fail_at_array, 0), partial(fail_at_array, 9), fail_at_manifest],
    ids=["first array", "tenth array", "manifest"],
)
@pytest.mark.parametrize("name", ["route.pfmap", "other.pfmap"])
def test_a_failure_in_mid_write_leaves_nothing_but_what_was_there(
    saved: Path,
    small_map: Map,
    monkeypatch: pytest.MonkeyPatch,
    fail: Callable[[pytest.MonkeyPatch], None],
    name: str,
) -> None:
    before = files_of(saved.parent)
    target = saved.with_name(name)
    fail(monkeypatch)
    with pytest.raises(MapError, match=f"{re.escape(str(target))}: .*disk is full"):
        save_map(small_map, target)
    assert files_of(saved.parent) == before
    assert os.listdir(saved.parent) == [saved.name]


def test_a_full_disk_leaves_the_older_map_whole(small_map: Map, tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    try:
        mounted = subprocess.run(mount, capture_output=True).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("mounting a small tmpfs is not permitted here")
    try:
        path = disk / "route.pfmap"
        save_map(small_map, path)
        thumbnails = np.zeros(1 << 20, np.uint8)
        large = replace(small_map, places=replace(small_map.places, thumbnails=thumbnails))
        for target in (path, disk / "other.pfmap"):
            with pytest.raises(MapError, match=f"{re.escape(str(target))}: .*disk is full"):
                save_map(large, target)
            assert os.listdir(disk) == [path.name]
        assert_same(small_map, open_map(path))
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)


KILLED_IN_MID_WRITE = """
import os, signal, sys
import numpy as np
from pathlib import Path
from placefield.maps.opening import open_map
from placefield.maps.store import save_map

older, target = map(Path, sys.argv[1:])
built = open_map(older)
save, written = np.save, []

def save_or_die(file, array, **options):
    if len(written) == 9:
        os.kill(os.getpid(), signal.SIGKILL)
    written.append(file)
    save(file, array, **options)

np.save = save_or_die
save_map(built, target)
"""


def test_a_killed_build_leaves_no_half_map(saved: Path, pristine: Path) -> None:
    other = saved.with_name("other.pfmap")
    for target in (saved, other):
        program = [sys.executable, "-c", KILLED_IN_MID_WRITE, str(pristine), str(target)]
        assert subprocess.run(program).returncode == -signal.SIGKILL
    assert files_of(saved) == files_of(pristine)
    assert not other.exists()
    assert all(left.name.startswith(".") for left in saved.parent.iterdir() if left != saved)
