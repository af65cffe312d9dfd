"""Fixtures of the tests of channel workers."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from placefield.features.descriptors import DescriptorStream
from placefield.features.extract import feature_of_model
from placefield.maps.map import Map
from placefield_services import channel_worker as worker_module


@pytest.fixture(autouse=True)
def ask_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a channel worker not wait for frames that no cache has."""
    monkeypatch.setattr(worker_module, "_ASK_FOR_S", 0.0)


@pytest.fixture(scope="session")
def descriptors(query_dir: Path, route_map: Map) -> list[NDArray[np.float32]]:
    """Return the descriptors of the first frames of the query."""
    stream = DescriptorStream(route_map.model)
    feature = feature_of_model(route_map.model)
    files = sorted(query_dir.iterdir())[:20]
    return [stream.update(feature.describe(file.read_bytes())) for file in files]
