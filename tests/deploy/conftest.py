"""Where the files of a deployment are."""

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def deploy() -> Path:
    return Path(__file__).resolve().parents[2] / "deploy"
