"""A drive that was explored is never lost: its map is saved, or it is kept for another try."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from full_disk import full_after
from laps import images_of_laps
from lenses import pinhole
from typer.testing import CliRunner

from placefield.config import BusConfig, Config
from placefield.errors import ConfigError, MapError, PlacefieldError
from placefield.features.extract import feature_of
from placefield.features.images import small_jpeg
from placefield.features.raw_stage import raw_fingerprint
from placefield.maps.drive_file import Drive, DriveFile, DriveFrame
from placefield.maps.opening import open_map
from placefield_services.mapper import drive_path, ended_path
from placefield_tools.cli.main import app
from placefield_tools.explore.explored_map import AskedMap
from placefield_tools.explore.exploring_host import explore

DRIVE = Drive("s", False, raw_fingerprint("gist"))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "laps.pfmap"


@pytest.fixture
def config(endpoint: str) -> Config:
    return Config.model_validate(
        {"bus": BusConfig(endpoint=endpoint), "scales": {"channels": 2, "clusters": 4}}
    )


def write_drive(path: Path, count: int = 140) -> DriveFile:
    file = DriveFile(path, DRIVE)
    describe = feature_of("gist").describe
    for number, image in enumerate(images_of_laps()[:count]):
        raw = describe(image)
        file.append(DriveFrame(number, number, None, raw, small_jpeg(image, 160)))
    return file


def run(path: Path, config: Config, stop: threading.Event) -> threading.Thread:
    """Explore in a thread, without services."""
    thread = threading.Thread(target=explore, args=(AskedMap(path, config), {}, stop))
    thread.start()
    return thread


@pytest.mark.parametrize("at", [drive_path, ended_path])
def test_a_drive_that_an_earlier_host_left_becomes_the_map(
    path: Path, config: Config, at: Callable[[Path], Path]
) -> None:
    write_drive(at(path)).close()
    assert explore(AskedMap(path, config), {}, threading.Event())
    assert open_map(path).places.count == 140
    assert [*path.parent.iterdir()] == [path]


def test_a_map_that_finds_no_room_is_one_error_and_the_drive_is_kept(
    path: Path, config: Config
) -> None:
    write_drive(ended_path(path)).close()
    before = ended_path(path).read_bytes()
    with full_after(1000), pytest.raises(MapError, match="disk is full"):
        explore(AskedMap(path, config), {}, threading.Event())
    assert [*path.parent.iterdir()] == [ended_path(path)]
    assert ended_path(path).read_bytes() == before
    assert explore(AskedMap(path, config), {}, threading.Event())


def test_while_a_map_finds_no_room_the_services_go_on(
    path: Path, config: Config, caplog: pytest.LogCaptureFixture
) -> None:
    stop = threading.Event()
    thread = run(path, config, stop)
    try:
        file = write_drive(path.with_name("elsewhere"))
        with full_after(1000):
            file.end(ended_path(path))
            while "the drive is kept" not in caplog.text:
                time.sleep(0.05)
        assert thread.is_alive()
    finally:
        stop.set()
        thread.join()
    assert not path.exists()
    assert ended_path(path).exists()


def test_after_a_drive_with_too_little_in_it_the_next_is_explored(
    path: Path, config: Config, caplog: pytest.LogCaptureFixture
) -> None:
    thread = run(path, config, threading.Event())
    write_drive(path.with_name("elsewhere"), 5).end(ended_path(path))
    while ended_path(path).exists():
        time.sleep(0.05)
    assert "no map of this drive" in caplog.text
    write_drive(path.with_name("elsewhere")).end(ended_path(path))
    thread.join(60)
    assert open_map(path).places.count == 140


def test_a_drive_of_another_feature_or_camera_is_kept(path: Path, config: Config) -> None:
    write_drive(drive_path(path), 5).close()
    camera = pinhole(96, 72, 60).calibration
    features = config.features.model_copy(update={"kind": "grayscale"})
    for asked in (
        AskedMap(path, config, camera),
        AskedMap(path, config.model_copy(update={"features": features})),
    ):
        with pytest.raises(ConfigError, match="explored with another feature or camera; give the"):
            explore(asked, {}, threading.Event())
    assert [*path.parent.iterdir()] == [drive_path(path)]


def test_a_drive_that_another_host_explores_is_left_alone(path: Path, config: Config) -> None:
    with_lock = write_drive(drive_path(path), 5)
    with pytest.raises(MapError, match="another process"):
        explore(AskedMap(path, config), {}, threading.Event())
    with_lock.close()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "give a MAP, or --explore"),
        (["m.pfmap", "--explore", "n.pfmap"], "give a MAP, or --explore"),
        (["m.pfmap", "--camera", "front.yaml"], "--camera: is for --explore and --ros"),
        (["--explore", "n.pfmap", "--camera", "no.yaml"], "no.yaml: cannot be read"),
        (["m.pfmap", "--feature", "gist"], "--feature"),
        (["--explore", "n.map"], "ends in .pfmap"),
        (["--explore", "n.pfmap", "--rule", "ams"], "rule ams"),
        (["--explore", "n.pfmap", "--run", "a", "--run", "b"], "runs a, b"),
        (["--explore", "n.pfmap", "--verifiers", "1"], "--verifiers: an explored drive keeps no"),
        (["--explore", "n.pfmap", "--set", "build.local_features=9"], "build.local_features"),
        (["--explore", "n.pfmap", "--feature", "onnx:none.onnx"], "none.onnx"),
    ],
)
def test_what_cannot_be_explored_is_refused(arguments: list[str], said: str) -> None:
    result = CliRunner().invoke(app, ["up", *arguments])
    assert isinstance(result.exception, PlacefieldError)
    assert said in str(result.exception)
