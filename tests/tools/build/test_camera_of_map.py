"""The view of a map: asked for at the build, kept by the map, and rendered of each query."""

import json
from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from typing import Any

import cv2
import numpy as np
import pytest
from lenses import BENT, STRAIGHT, Pixels
from typer.testing import CliRunner

from placefield import Frame, FrameError, Recognizer, build_map
from placefield.config import Config
from placefield.errors import ConfigError, MapError
from placefield.features.rectification import rectify, view_of
from placefield.maps.manifest import seal_of
from placefield.maps.map import fingerprint
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.build.used_part import AskedPart
from placefield_tools.cli.main import app
from placefield_tools.inspect.map_facts import map_facts
from placefield_tools.sources import Parts, open_source

CONFIG = Config.model_validate({"metric": {"kind": "identity"}, "scales": {"channels": 1}})


def read(file: Path) -> Pixels:
    pixels = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None
    return np.asarray(pixels, np.uint8)


@pytest.fixture(scope="module")
def map_path(
    reference_dir: Path, cameras: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A map of the reference that is narrowed to what both cameras see."""
    straight, bent = cameras
    images = AskedPart(query_cameras=[bent])
    built = build_from([str(reference_dir)], CONFIG, parts=Parts(camera=straight), images=images)
    path = tmp_path_factory.mktemp("maps") / "route.pfmap"
    save_map(built, path)
    return path


def test_the_view_of_both_cameras_travels_with_the_map(map_path: Path) -> None:
    model = open_map(map_path).model
    view = view_of(STRAIGHT.calibration).common(view_of(BENT.calibration))
    assert model.view == view
    said = map_facts(open_map(map_path))["view"]
    assert said == f"rectified to {view.degrees[0]:.0f}° × {view.degrees[1]:.0f}°"
    other = build_map([Frame(n, n, "", image) for n, image in enumerate(noise())], config=CONFIG)
    assert other.model.view is None


def noise(count: int = 12) -> list[Pixels]:
    rng = np.random.default_rng(0)
    return [
        np.asarray(cv2.resize(rng.integers(0, 256, (9, 12), np.uint8), (96, 72)), np.uint8)
        for _ in range(count)
    ]


def evaluated(*words: str | Path) -> str:
    done = CliRunner().invoke(app, ["evaluate", *map(str, words), "--aligned", "--json"])
    return done.output + str(done.exception or "")


def test_a_query_of_another_camera_is_evaluated_with_its_file_only(
    map_path: Path, bent_dir: Path, query_dir: Path, cameras: tuple[Path, Path], tmp_path: Path
) -> None:
    straight, bent = cameras
    output = ("-o", tmp_path / "plots")
    found = evaluated(map_path, bent_dir, "--camera", bent, *output)
    assert json.loads(found[found.index("{") :])["rules"], found
    assert "give the camera's calibration, as by --camera" in evaluated(map_path, bent_dir, *output)
    refused = evaluated(map_path, bent_dir, "--query-camera", bent, *output)
    assert f"{map_path} is built already; give the camera of QUERY as --camera" in refused
    text = straight.read_text().replace("image_width: 96", "image_width: 128")
    (tmp_path / "other.yaml").write_text(text)
    said = evaluated(map_path, query_dir, "--camera", tmp_path / "other.yaml", *output)
    assert "the image is 96×72, and its camera was calibrated for 128×72" in said


def test_frames_of_two_cameras_are_evaluated_as_on_a_map_of_what_both_see(
    map_path: Path, reference_dir: Path, bent_dir: Path, cameras: tuple[Path, Path], tmp_path: Path
) -> None:
    straight, bent = cameras
    how = ("--channels", "1", "--metric", "identity", "-o", tmp_path / "plots")
    each = (
        evaluated(reference_dir, bent_dir, "--camera", straight, "--query-camera", bent, *how),
        evaluated(map_path, bent_dir, "--camera", bent, "-o", tmp_path / "plots"),
    )
    of_frames, of_map = (json.loads(said[said.index("{") :])["rules"] for said in each)
    assert of_frames == of_map


def test_a_drive_is_added_with_the_camera_that_took_it(
    map_path: Path, bent_dir: Path, cameras: tuple[Path, Path], tmp_path: Path
) -> None:
    def add(*flags: str | Path) -> str:
        words = ["add", map_path, bent_dir, "-o", tmp_path / "more.pfmap", *flags]
        done = CliRunner().invoke(app, list(map(str, words)))
        return done.output + str(done.exception or "")

    assert "as by --camera" in add()
    said = add("--camera", cameras[1])
    assert "60 places" in said, said
    assert open_map(tmp_path / "more.pfmap").model.view == open_map(map_path).model.view


def test_a_recognizer_takes_frames_with_the_calibration_of_their_camera(
    map_path: Path, bent_dir: Path
) -> None:
    recognizer = Recognizer(open_map(map_path))
    files = sorted(bent_dir.iterdir())[:20]
    with pytest.raises(FrameError, match="give a Frame with its calibration"):
        recognizer.update(files[0])
    for number, file in enumerate(files):
        frame = Frame(number, number, file.name, read(file), calibration=BENT.calibration)
        match = recognizer.update_frame(frame)
    assert abs(match.place - 19) <= 3


def test_build_map_takes_the_view_of_the_first_camera() -> None:
    frames = [Frame(0, 0, "", each, calibration=BENT.calibration) for each in noise()]
    assert build_map(frames, config=CONFIG).model.view == view_of(BENT.calibration)


def test_a_mask_is_of_the_rectified_image(
    reference_dir: Path, cameras: tuple[Path, Path], tmp_path: Path
) -> None:
    view = view_of(BENT.calibration)
    fits, frame = tmp_path / "fits.png", tmp_path / "frame.png"
    rectified = rectify(read(min(reference_dir.iterdir())), STRAIGHT.calibration, view)
    for file, (height, width) in ((fits, rectified.shape), (frame, (72, 48))):
        painted = np.full((height, width), 255, np.uint8)
        painted[height // 2 :] = 0
        cv2.imwrite(str(file), painted)

    def build(mask: Path) -> None:
        images = AskedPart(str(mask), [cameras[1]])
        parts = Parts(camera=cameras[0])
        built = build_from([str(reference_dir)], CONFIG, parts=parts, images=images)
        assert built.model.view == view
        assert built.model.mask is not None

    build(fits)
    with pytest.raises(ConfigError, match=r"frame\.png: the image is \d+×\d+, and its mask is 48"):
        build(frame)


def test_what_does_not_fit_is_refused_in_one_line(
    reference_dir: Path, cameras: tuple[Path, Path], map_path: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"^--query-camera: .*; give --camera$"):
        build_from([str(reference_dir)], CONFIG, images=AskedPart(query_cameras=cameras))
    np.save(tmp_path / "ref.npy", np.eye(12, dtype=np.float32))
    with pytest.raises(ConfigError, match=r"straight\.yaml: needs images"):
        open_source(str(tmp_path / "ref.npy"), parts=Parts(camera=cameras[0]))


@pytest.mark.parametrize(
    "command",
    [
        "build FRAMES -o new.pfmap",
        "add MAP FRAMES -o new.pfmap",
        "evaluate MAP FRAMES --aligned",
        "study FRAMES FRAMES --aligned",
        "loops FRAMES -o loops.csv",
        "replay FRAMES",
        "chaos MAP FRAMES",
        "up --explore new.pfmap",
    ],
)
def test_each_command_that_reads_frames_takes_the_camera(
    command: str,
    map_path: Path,
    query_dir: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    named = {"MAP": str(map_path), "FRAMES": str(query_dir)}
    words = [named.get(word, word) for word in command.split()]
    done = CliRunner().invoke(app, [*words, "--camera", "no.yaml"])
    assert str(done.exception) == "no.yaml: cannot be read: No such file or directory"


def with_view(path: Path, view: Callable[[dict[str, Any]], None]) -> Path:
    """Change a saved map's manifest, and seal it again."""
    manifest = json.loads((path / "manifest.json").read_text())
    view(manifest)
    written = json.dumps(manifest).encode()
    (path / "manifest.json").write_bytes(written)
    (path / "manifest.sha256").write_bytes(seal_of(written))
    return path


def test_a_map_of_before_views_is_opened_as_it_was(
    map_path: Path, reference_dir: Path, tmp_path: Path
) -> None:
    built = build_from([str(reference_dir)], CONFIG)
    save_map(built, tmp_path / "old.pfmap")
    opened = open_map(with_view(tmp_path / "old.pfmap", lambda manifest: manifest.pop("view")))
    assert opened.model.view is None
    assert fingerprint(opened.model) == fingerprint(built.model)
    assert fingerprint(built.model) != fingerprint(open_map(map_path).model)


@pytest.mark.parametrize(
    ("view", "reason"),
    [
        (None, "its descriptor model is not the manifest's"),
        ({"half_width": 0.5, "half_height": 0.5}, "its descriptor model is not the manifest's"),
        ({"half_width": 0.0, "half_height": 0.5}, "view.half_width: .*greater"),
        ({"half_width": 2.0, "half_height": 0.5}, "view.half_width: .*less"),
        ({"half_width": 0.5}, "view.half_height: .*required"),
    ],
)
def test_a_map_of_another_view_or_none_of_a_camera_is_refused(
    map_path: Path, view: object, reason: str, tmp_path: Path
) -> None:
    path = Path(copytree(map_path, tmp_path / "route.pfmap"))
    with pytest.raises(MapError, match=reason):
        open_map(with_view(path, lambda manifest: manifest.update(view=view)))
