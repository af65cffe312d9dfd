"""A host that several tests use, and a query that is not all well."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hosting import UNREADABLE, Host, Listener


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("logs")


@pytest.fixture(scope="session")
def host(logs: Path, map_path: Path) -> Iterator[Host]:
    """A host with two channel workers and the default rule; leave it as it was."""
    with Host(logs, map_path, "--workers", "2") as running:
        yield running


@pytest.fixture
def listener(host: Host) -> Iterator[Listener]:
    with host.listener() as listening:
        yield listening


@pytest.fixture(scope="session")
def damaged_dir(made_up: Path, mixed_dir: Path) -> Path:
    """The query of all sorts of frames, some of which cannot be read."""
    damaged = shutil.copytree(mixed_dir, made_up / "damaged")
    files = sorted(damaged.iterdir())
    for number, size in UNREADABLE.items():
        files[number].write_bytes(files[number].read_bytes()[:size])
    return damaged
