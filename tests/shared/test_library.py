"""The library on its own: what a program imports from ``placefield``, with no bus."""

import inspect
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import Normalizer
from threadpoolctl import threadpool_limits

import placefield
from placefield import (
    Config,
    Describer,
    Frame,
    Pose,
    Recognizer,
    build_map,
    errors,
    open_map,
    save_map,
)
from placefield.errors import FrameError, MapError, SourceError
from placefield.features.extract import feature_of
from placefield.features.images import decode
from placefield.maps.map import Map


@pytest.fixture
def files(reference_dir: Path) -> list[Path]:
    return sorted(reference_dir.glob("*.jpg"))


def test_every_public_name_is_there() -> None:
    assert tuple(placefield._HOMES) == placefield.__all__
    assert len(set(placefield.__all__)) == len(placefield.__all__)
    assert all(getattr(placefield, name) is not None for name in placefield.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = placefield.nothing  # type: ignore[attr-defined]


def test_every_known_error_is_public() -> None:
    known = {name for name, kind in vars(errors).items() if inspect.isclass(kind)}
    assert known <= set(placefield.__all__)


def test_five_lines_recognise_a_route(files: list[Path], query_dir: Path) -> None:
    recognizer = Recognizer(build_map(files))
    matches = [recognizer.update(image) for image in sorted(query_dir.iterdir())]
    right = [abs(match.place - frame) <= 3 for frame, match in enumerate(matches)]
    assert np.mean(right) > 0.9


def test_it_is_the_map_that_the_command_builds(
    files: list[Path], route_map: Map, tmp_path: Path
) -> None:
    config = Config(scales=route_map.scales, metric=route_map.metric, seed=route_map.seed)
    save_map(build_map(files, config=config), tmp_path / "route.pfmap")
    built = open_map(tmp_path / "route.pfmap")
    for ours, other in zip(built.channels, route_map.channels, strict=True):
        np.testing.assert_array_equal(ours.segments, other.segments)
        np.testing.assert_array_equal(ours.metric.places, other.metric.places)


def test_a_map_does_not_depend_on_how_many_threads_there_are(files: list[Path]) -> None:
    config = Config.model_validate({"features": {"kind": "grayscale"}})

    def built(threads: int) -> Map:
        with threadpool_limits(threads):
            return build_map(files, config=config)

    one, two = built(1), built(2)
    np.testing.assert_array_equal(one.model.components, two.model.components)
    np.testing.assert_array_equal(one.metrics[0].places, two.metrics[0].places)


def test_a_pose_that_is_not_finite_is_refused(files: list[Path]) -> None:
    poses = [Pose(5.0, 0.0, 0.0)] * 7 + [Pose(np.nan, 0.0, 0.0)]
    frames = [Frame(0, at, "", decode(files[at].read_bytes()), poses[at]) for at in range(8)]
    with pytest.raises(MapError, match="traverse 0: the pose of frame 7 is not finite"):
        build_map(frames)


def test_files_bytes_and_pixels_are_alike(files: list[Path]) -> None:
    in_bytes = [file.read_bytes() for file in files]
    in_pixels = [decode(image) for image in in_bytes]
    maps = [build_map(images) for images in (files, in_bytes, in_pixels)]
    for other in maps[1:]:
        np.testing.assert_array_equal(other.metrics[0].places, maps[0].metrics[0].places)


def test_large_jpegs_are_recognised_as_their_pixels_are(files: list[Path], query_dir: Path) -> None:
    def enlarged(file: Path) -> bytes:
        large = cv2.resize(decode(file.read_bytes()), (1440, 1080), interpolation=cv2.INTER_CUBIC)
        return cv2.imencode(".jpg", large)[1].tobytes()

    reference = [enlarged(file) for file in files[:30]]
    query = [enlarged(file) for file in sorted(query_dir.iterdir())[:30]]
    in_parts = Recognizer(build_map(reference))
    whole = Recognizer(build_map([decode(jpeg) for jpeg in reference]))
    matches = [(in_parts.update(jpeg), whole.update(decode(jpeg))) for jpeg in query]
    assert [one.place for one, _ in matches] == [other.place for _, other in matches]
    right = [abs(match.place - frame) <= 3 for frame, (match, _) in enumerate(matches)]
    assert np.mean(right) > 0.9


def test_frames_bring_their_stamps_and_poses(files: list[Path]) -> None:
    frames = [
        Frame(0, 7 * number, file.name, file.read_bytes(), Pose(number, 0, 0))
        for number, file in enumerate(files)
    ]
    places = build_map(frames).places
    assert places.stamps.tolist() == [7 * number for number in range(len(files))]
    assert places.poses[:, 0].tolist() == list(range(len(files)))


def test_frames_that_do_not_make_a_map_are_refused_in_one_line(
    files: list[Path], tmp_path: Path
) -> None:
    with pytest.raises(SourceError, match=r"nothing\.jpg: cannot be read"):
        build_map([*files, tmp_path / "nothing.jpg"])
    with pytest.raises(FrameError, match="traverse 0, frame 1"):
        build_map([files[0].read_bytes(), b"no image"])
    with pytest.raises(SourceError, match="an image as str: give bytes, pixels or a Path"):
        build_map([str(file) for file in files])  # type: ignore[misc]
    for one in (files[0], decode(files[0].read_bytes())):
        with pytest.raises(SourceError, match="traverse 0: is one image"):
            build_map(one, one)  # type: ignore[arg-type]
    for nothing in ([], [[]]):
        with pytest.raises(MapError, match="frames"):
            build_map(*nothing)


def test_a_describer_is_a_step_of_a_scikit_learn_pipeline(files: list[Path]) -> None:
    images = [file.read_bytes() for file in files]
    describer = clone(Describer(dimensions=20))
    model = build_map(images, config=Config.model_validate({"features": {"dimensions": 20}})).model
    raw = np.stack([feature_of("gist").describe(image) for image in images])
    described = make_pipeline(describer, Normalizer()).fit_transform(images)
    np.testing.assert_allclose(described, model.of_reference(raw), atol=1e-6)


def test_importing_it_loads_nothing_heavy() -> None:
    heavy = "{'cv2', 'numba', 'scipy', 'sklearn', 'zenoh'}"
    command = f"import sys, placefield; print({heavy} & set(sys.modules))"
    shown = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True)
    assert shown.stdout == "set()\n"
