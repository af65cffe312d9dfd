"""The environment of the processes that another process starts."""

import os

from placefield.loading import ENV_PREFIX
from placefield_services.notifying import NOTIFY_SOCKET

SUPERVISED = "PLACEFIELD_SUPERVISED"
"""Environment variable of a process whose standard input ends when its parent process ends."""


def child_environment() -> dict[str, str]:
    """Return the environment for services and sources that this process starts.

    It has no Placefield settings: the command lines carry the whole configuration. It has no
    notification socket: only the parent process reports to a supervisor. Each process has one BLAS
    thread, as they already run in parallel.
    """
    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(ENV_PREFIX) and name != NOTIFY_SOCKET
    }
    return kept | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def supervised_environment() -> dict[str, str]:
    """Return ``child_environment()`` for a process that ends when its standard input does."""
    return child_environment() | {SUPERVISED: "1"}
