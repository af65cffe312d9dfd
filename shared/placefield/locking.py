"""File locks between processes: the second process that locks a file fails at once."""

from importlib.util import find_spec
from typing import IO

from placefield.errors import ConfigError


def has_locks() -> bool:
    """Return whether the system has such locks; Windows has not."""
    return find_spec("fcntl") is not None


def take_lock(file: IO[bytes]) -> bool:
    """Lock an open file until it is closed, however the process ends; False if it is locked.

    Raises:
        ConfigError: the system has no such locks, for example Windows.
    """
    if not has_locks():
        raise ConfigError(
            f"{file.name}: needs a lock that this system has not; use Linux, macOS or WSL"
        )
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
