"""What is refused when a map is opened."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from placefield.errors import MapError
from placefield.maps.checksums import checksum_of
from placefield.maps.manifest import MANIFEST, SEAL, read_manifest
from placefield.maps.opening import open_map

MODEL_ARRAYS = ["features/mean", "features/deviation", "features/components"]
ARRAYS_PER_PLACE = ["places/stamps", "places/poses", "places/thumbnail_ends"]
CHANNEL_ARRAYS = [f"channels/1/{name}" for name in ("labels", "segments", "scales", "curve")]
METRIC_ARRAYS = [f"metrics/0/{name}" for name in ("projection", "places", "squares", "steps")]
ARRAYS = [*MODEL_ARRAYS, *ARRAYS_PER_PLACE, "places/thumbnails", *METRIC_ARRAYS, *CHANNEL_ARRAYS]


def refusal(path: Path) -> str:
    with pytest.raises(MapError) as refused:
        open_map(path)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def rewrite(path: Path, name: str, change: Callable[[NDArray[Any]], Any]) -> Path:
    """Change an array as somebody might by hand, its checksum too; return its file."""
    file = path / f"{name}.npy"
    np.save(file, change(np.load(file)), allow_pickle=True)
    files = json.loads((path / MANIFEST).read_text())["files"]
    files[f"{name}.npy"] = checksum_of(file)
    edit_manifest(path, files=files)
    return file


def edit_manifest(path: Path, **changes: Any) -> None:
    """Change the manifest as one who knows its checksum would."""
    write_manifest(path, json.loads((path / MANIFEST).read_text()) | changes)


def write_manifest(path: Path, manifest: dict[str, Any]) -> None:
    """Write it with its seal, in the words of sha256sum."""
    (path / MANIFEST).write_text(json.dumps(manifest))
    checksum = sha256((path / MANIFEST).read_bytes()).hexdigest()
    (path / SEAL).write_text(f"{checksum}  {MANIFEST}\n")


@contextmanager
def one_bit_flipped(file: Path, data: st.DataObject) -> Iterator[None]:
    whole = file.read_bytes()
    bit = data.draw(st.integers(0, 8 * len(whole) - 1))
    damaged = bytearray(whole)
    damaged[bit // 8] ^= 1 << bit % 8
    file.write_bytes(damaged)
    try:
        yield
    finally:
        file.write_bytes(whole)


@settings(max_examples=60)
@given(data=st.data())
def test_any_flipped_bit_of_an_array_is_refused_by_the_name_of_its_file(
    pristine: Path, data: st.DataObject
) -> None:
    file = data.draw(st.sampled_from(sorted(pristine.rglob("*.npy"))))
    with one_bit_flipped(file, data):
        assert refusal(pristine).startswith(f"{file}: damaged")


@settings(max_examples=150)
@given(data=st.data())
def test_any_flipped_bit_of_the_manifest_or_its_seal_is_refused(
    pristine: Path, data: st.DataObject
) -> None:
    file = data.draw(st.sampled_from([MANIFEST, SEAL]))
    with one_bit_flipped(pristine / file, data):
        assert refusal(pristine).startswith(f"{pristine / MANIFEST}: ")


def test_a_manifest_without_its_seal_is_refused(saved: Path) -> None:
    (saved / SEAL).unlink()
    assert refusal(saved).startswith(f"{saved / SEAL}: missing")


def test_a_setting_that_has_come_since_leaves_a_map_whole(saved: Path) -> None:
    manifest = json.loads((saved / MANIFEST).read_text())
    for section in ("features", "scales", "metric"):
        defaults = type(getattr(read_manifest(saved), section))().model_dump()
        name = next(key for key in manifest[section] if manifest[section][key] == defaults[key])
        del manifest[section][name]
    write_manifest(saved, manifest)
    assert open_map(saved).places.count == manifest["places"]


@pytest.mark.parametrize("share", [0, 0.1, 0.5, 0.99])
def test_a_truncated_manifest_is_refused(saved: Path, share: float) -> None:
    whole = (saved / MANIFEST).read_bytes()
    (saved / MANIFEST).write_bytes(whole[: int(share * len(whole))])
    assert refusal(saved).startswith(f"{saved / MANIFEST}: ")


@pytest.mark.parametrize("version", [1, 4, 6])
def test_a_manifest_of_another_format_version_is_refused(saved: Path, version: int) -> None:
    edit_manifest(saved, format=version, something_new=1)
    assert refusal(saved).startswith(f"{saved / MANIFEST}: format: ")


def test_where_there_is_no_map_this_is_said(tmp_path: Path) -> None:
    (tmp_path / "file.pfmap").write_text("no map")
    for path in (tmp_path, tmp_path / "missing.pfmap", tmp_path / "file.pfmap"):
        assert refusal(path).startswith(f"{path}: no map there")


@pytest.mark.parametrize("name", ARRAYS)
def test_a_missing_array_is_refused_by_its_name(saved: Path, name: str) -> None:
    file = saved / f"{name}.npy"
    file.unlink()
    assert refusal(saved).startswith(f"{file}: missing")
    file.mkdir()
    assert refusal(saved).startswith(f"{file}: missing")


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize(
    "change",
    [
        lambda array: array[None],
        lambda array: array.astype(np.complex64),
        lambda array: np.zeros((), array.dtype),
    ],
    ids=["axis", "dtype", "scalar"],
)
def test_an_array_that_was_made_another_is_refused_by_its_name(
    saved: Path, name: str, change: Callable[[NDArray[Any]], NDArray[Any]]
) -> None:
    file = rewrite(saved, name, change)
    assert refusal(saved).startswith(f"{file}: does not fit")


@pytest.mark.parametrize(
    "name", [*ARRAYS_PER_PLACE, "metrics/0/places", "metrics/0/squares", "channels/1/labels"]
)
def test_an_array_of_other_length_than_the_others_is_refused(saved: Path, name: str) -> None:
    file = rewrite(saved, name, lambda array: array[:-1])
    assert refusal(saved).startswith(f"{file}: does not fit")


@pytest.mark.parametrize("scales", [[], [0, 4], [8, 4], [4, 4]])
def test_scales_that_no_matcher_could_use_are_refused(saved: Path, scales: list[int]) -> None:
    file = rewrite(saved, "channels/1/scales", lambda _: np.array(scales, np.int32))
    assert refusal(saved).startswith(f"{file}: ")


@pytest.mark.parametrize("axis", [0, -1])
@pytest.mark.parametrize("name", METRIC_ARRAYS)
def test_a_metric_of_other_places_or_other_dimensions_is_refused(
    saved: Path, name: str, axis: int
) -> None:
    rewrite(saved, name, lambda array: array.take(range(array.shape[axis] - 1), axis))
    assert refusal(saved).startswith(str(saved / "metrics/0"))


@pytest.mark.parametrize("number", [1, 99, -1, None, 0.5])
def test_a_channel_of_a_metric_that_is_not_there_is_refused(saved: Path, number: Any) -> None:
    channels = json.loads((saved / MANIFEST).read_text())["channels"]
    edit_manifest(saved, channels=[channels[0], channels[1] | {"metric": number}])
    assert "metric" in refusal(saved)


@pytest.mark.parametrize("unit", [0, -0.1, float("inf"), float("nan"), None, "missing"])
def test_a_metric_without_a_unit_is_refused(saved: Path, unit: Any) -> None:
    (metric,) = json.loads((saved / MANIFEST).read_text())["metrics"]
    changed = {"unit": unit} if unit != "missing" else {}
    edit_manifest(saved, metrics=[{"learned": metric["learned"]} | changed])
    assert refusal(saved).startswith(f"{saved / MANIFEST}: metrics.0.unit: ")


def test_a_metric_without_its_files_and_a_map_without_metrics_are_refused(saved: Path) -> None:
    manifest = json.loads((saved / MANIFEST).read_text())
    (metric,), (first, other) = manifest["metrics"], manifest["channels"]
    edit_manifest(saved, metrics=[metric, metric], channels=[first, other | {"metric": 1}])
    assert refusal(saved).startswith(f"{saved / 'metrics/1/projection.npy'}: missing")
    edit_manifest(saved, metrics=[])
    assert refusal(saved).startswith(f"{saved / MANIFEST}: metrics: ")


def test_an_array_of_objects_is_refused(saved: Path) -> None:
    file = rewrite(saved, "places/stamps", lambda array: array.astype(object))
    assert refusal(saved).startswith(f"{file}: not an array")


@pytest.mark.parametrize("name", MODEL_ARRAYS)
def test_a_descriptor_model_of_another_map_is_refused(saved: Path, name: str) -> None:
    rewrite(saved, name, lambda array: array + 1)
    assert "descriptor model" in refusal(saved)


def test_a_manifest_that_says_other_than_the_arrays_is_refused(saved: Path) -> None:
    features = json.loads((saved / MANIFEST).read_text())["features"]
    changes: list[dict[str, Any]] = [
        {"places": 89},
        {"pose_frame": None},
        {"features": features | {"kind": "grayscale"}},
        {"features": features | {"standardise": False}},
    ]
    whole = (saved / MANIFEST).read_bytes()
    for change in changes:
        edit_manifest(saved, **change)
        assert refusal(saved).startswith(str(saved))
        (saved / MANIFEST).write_bytes(whole)
