"""Small made-up routes and maps, for tests of what does not look at pixels."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.config import Config
from placefield.maps.build import build_map
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield.maps.traverse import Traverse


@pytest.fixture(scope="session")
def make_traverse() -> Callable[..., Traverse]:
    """Traverses of a route whose views change gradually and, every so often, at once."""

    def make(
        frames: int = 90,
        *,
        name: str = "made-up",
        noise: float | NDArray[np.float64] = 0,
        spacing: float | None = None,
    ) -> Traverse:
        rng = np.random.default_rng(8)
        steps = rng.normal(scale=0.3, size=(frames, 30))
        steps[rng.choice(frames, frames // 12, replace=False)] *= 6
        views = 5 + np.cumsum(steps, axis=0) + rng.normal(scale=noise, size=steps.shape)
        poses = np.zeros((0 if spacing is None else frames, 3))
        poses[:, 0] = np.arange(len(poses)) * (spacing or 0)
        return Traverse(
            name,
            views.astype(np.float32),
            np.arange(frames, dtype=np.int64) * 100_000_000,
            poses,
            poses[:, 0],
            tuple(b"thumbnail %d" % number for number in range(frames)),
        )

    return make


@pytest.fixture(scope="session")
def make_map() -> Callable[[Traverse], Map]:
    """Maps of two channels under the identity metric."""

    def make(traverse: Traverse) -> Map:
        config = Config.model_validate({"scales": {"channels": 2}, "metric": {"kind": "identity"}})
        return build_map([traverse], config)

    return make


@pytest.fixture(scope="session")
def small_map(make_map: Callable[[Traverse], Map], make_traverse: Callable[..., Traverse]) -> Map:
    """A map without poses."""
    return make_map(make_traverse())


@pytest.fixture(scope="session")
def posed_map(make_map: Callable[[Traverse], Map], make_traverse: Callable[..., Traverse]) -> Map:
    """The same route with poses."""
    return make_map(make_traverse(spacing=0.5))


@pytest.fixture(scope="session")
def pristine(posed_map: Map, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map that every test leaves as it is."""
    path = tmp_path_factory.mktemp("store") / "pristine.pfmap"
    save_map(posed_map, path)
    return path


@pytest.fixture
def saved(pristine: Path, tmp_path: Path) -> Path:
    """A map for one test to damage, alone in its folder."""
    return Path(shutil.copytree(pristine, tmp_path / "route.pfmap"))
