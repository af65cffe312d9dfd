"""What all tests share."""

import os
import sys
from collections.abc import Callable, Iterator, Mapping
from inspect import signature
from pathlib import Path
from shutil import copy, which
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from hypothesis import settings
from lenses import BENT, STRAIGHT

from placefield.config import Config
from placefield.features.images import decode
from placefield.maps.map import Map
from placefield.maps.opening import open_map
from placefield.maps.store import save_map
from placefield.matching.comparing import Comparison
from placefield.matching.filter_matcher import FilterMatcher
from placefield.matching.matcher import Partial
from placefield.matching.roads import RouteCells
from placefield_tools.build.map_from_sources import build_from
from placefield_tools.common.host_process import free_endpoint

if TYPE_CHECKING:
    from playwright.sync_api import Browser

settings.register_profile("no deadline", deadline=None)  # the machine may be shared
settings.load_profile("no deadline")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what takes real frames or networks as slow."""
    for item in items:
        if {"data_dir", "models_dir"} & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)


_DATA = Path(
    os.environ.get("PLACEFIELD_DATA") or Path(__file__).resolve().parents[2] / "shared" / "data"
)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of real frames, which are not part of the project."""
    if not _DATA.is_dir():
        pytest.skip(f"no real frames at {_DATA}; say where they are with PLACEFIELD_DATA")
    return _DATA


_MODELS = Path(
    os.environ.get("PLACEFIELD_MODELS") or Path(__file__).resolve().parents[2] / "shared" / "models"
)


@pytest.fixture(scope="session")
def models_dir() -> Path:
    """The folder of real networks, which are not part of the project."""
    if not _MODELS.is_dir():
        pytest.skip(f"no networks at {_MODELS}; say where they are with PLACEFIELD_MODELS")
    return _MODELS


@pytest.fixture
def given_odometry(monkeypatch: pytest.MonkeyPatch) -> list[float | None]:
    """The odometry readings that all filters are given from now on, frame by frame."""
    given: list[float | None] = []
    local = FilterMatcher.local

    def recording(
        self: FilterMatcher, frame: Comparison | None, odometry_m: float | None = None
    ) -> Partial:
        given.append(odometry_m)
        return local(self, frame, odometry_m)

    monkeypatch.setattr(FilterMatcher, "local", recording)
    return given


@pytest.fixture
def given_cells(monkeypatch: pytest.MonkeyPatch) -> list[RouteCells | None]:
    """The cells of places that the filters which begin from now on are given."""
    given: list[RouteCells | None] = []
    begin: Callable[..., None] = FilterMatcher.__init__

    def recording(*arguments: Any, **more: Any) -> None:
        given.append(signature(begin).bind(*arguments, **more).arguments["whole"].roads.cells)
        begin(*arguments, **more)

    monkeypatch.setattr(FilterMatcher, "__init__", recording)
    return given


FRAMES = 60
_HEIGHT, _WIDTH, _STEP = 72, 96, 16  # pixels


def _write_pan(folder: Path, *, shift: int, brightness: float) -> Path:
    """Write frames of a camera that pans along a wall of smooth random colours."""
    rng = np.random.default_rng(7)
    length = FRAMES * _STEP + 2 * _WIDTH
    wall = np.zeros((_HEIGHT, length, 3), np.float32)
    for grain in (4, 8, 16, 32):
        colours = rng.standard_normal((_HEIGHT // grain + 2, length // grain + 2, 3))
        wall += np.sqrt(grain) * cv2.resize(colours, (length, _HEIGHT)).astype(np.float32)
    wall = 255 * brightness * (wall - wall.min()) / np.ptp(wall)
    folder.mkdir()
    for number in range(FRAMES):
        left = number * _STEP + shift
        cv2.imwrite(str(folder / f"{number:04}.jpg"), wall[:, left : left + _WIDTH])
    return folder


@pytest.fixture(scope="session")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for what is made up once for all tests."""
    return tmp_path_factory.mktemp("made-up")


@pytest.fixture(scope="session")
def reference_dir(made_up: Path) -> Path:
    """Frames of a reference traverse; do not change them."""
    return _write_pan(made_up / "reference", shift=0, brightness=1.0)


@pytest.fixture(scope="session")
def query_dir(made_up: Path) -> Path:
    """Frames of the same route, darker and from a little further to the side."""
    return _write_pan(made_up / "query", shift=5, brightness=0.7)


@pytest.fixture(scope="session")
def cameras(made_up: Path) -> tuple[Path, Path]:
    """The files of the cameras of the reference and of ``bent_dir``."""
    return STRAIGHT.write(made_up / "straight.yaml"), BENT.write(made_up / "bent.yaml")


@pytest.fixture(scope="session")
def bent_dir(made_up: Path, query_dir: Path) -> Path:
    """The query, as a camera with a fisheye lens takes it."""
    folder = made_up / "bent"
    folder.mkdir()
    for file in sorted(query_dir.glob("*.jpg")):
        pixels = cv2.cvtColor(decode(file.read_bytes()), cv2.COLOR_BGR2GRAY)
        bent = BENT.retaken(np.asarray(pixels, np.uint8), STRAIGHT.focal[0])
        cv2.imwrite(str(folder / f"{file.stem}.png"), bent)
    return folder


@pytest.fixture(scope="session")
def mixed_dir(made_up: Path, query_dir: Path) -> Path:
    """The query again, as JPEG and PNG of several sizes, depths and channels."""
    mixed = made_up / "mixed"
    mixed.mkdir()
    for number, file in enumerate(sorted(query_dir.iterdir())):
        pixels = decode(file.read_bytes())
        forms = {
            1: cv2.resize(pixels, None, fx=1.5, fy=2),
            2: pixels.astype(np.uint16) * 257,
            3: cv2.cvtColor(pixels, cv2.COLOR_BGR2BGRA),
            4: cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY),
        }
        if number % 5 in forms:
            cv2.imwrite(str(mixed / f"{file.stem}.png"), forms[number % 5])
        else:
            copy(file, mixed)
    return mixed


@pytest.fixture(scope="session")
def map_path(made_up: Path, reference_dir: Path) -> Path:
    """A map of the reference, of 3 channels under the identity metric; do not change it."""
    config = Config.model_validate({"scales": {"channels": 3}, "metric": {"kind": "identity"}})
    path = made_up / "route.pfmap"
    save_map(build_from([str(reference_dir)], config), path)
    return path


@pytest.fixture(scope="session")
def route_map(map_path: Path) -> Map:
    """The same map, open."""
    return open_map(map_path)


@pytest.fixture(scope="session")
def verified_map_path(made_up: Path, reference_dir: Path) -> Path:
    """A map of the reference that keeps local features; do not change it."""
    config = Config.model_validate(
        {
            "build": {"local_features": 100},
            "scales": {"channels": 1},
            "metric": {"kind": "identity"},
        }
    )
    path = made_up / "verified.pfmap"
    save_map(build_from([str(reference_dir)], config), path)
    return path


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Path]]:
    """Install a package as pip does: its module, and a dist-info folder with its entry points."""

    def installed(name: str, code: str, groups: Mapping[str, Mapping[str, str]]) -> Path:
        site = tmp_path / f"site-{name}"
        about = site / f"{name}-1.0.dist-info"
        about.mkdir(parents=True)
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = []
        for group, entries in groups.items():
            lines += [f"[{group}]", *(f"{entry} = {value}" for entry, value in entries.items())]
        (about / "entry_points.txt").write_text("\n".join(lines))
        (site / f"{name}.py").write_text(code)
        monkeypatch.syspath_prepend(site)
        names.append(name)
        return site

    names: list[str] = []
    yield installed
    for name in names:
        sys.modules.pop(name, None)


@pytest.fixture
def no_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let ``evaluate`` draw nothing, where a test is about its figures."""
    monkeypatch.setattr("placefield_tools.evaluate.evaluation_plots.draw", lambda *_: [])


@pytest.fixture
def endpoint() -> str:
    """A free port of loopback, as the bus spells it."""
    return free_endpoint()


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    """A browser; while it is open, its event loop runs here, so no other test can run one."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    names = ("chromium", "chromium-browser", "google-chrome")
    found = next(filter(None, map(which, names)), None)
    if found is None:
        pytest.skip(f"no browser: none of {', '.join(names)}")
    with playwright.sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield running
        running.close()
