"""Locks of files: of two processes that take one, the second is told so, and does not wait."""

from typing import IO

from placefield.errors import ConfigError


def take_lock(file: IO[bytes]) -> bool:
    """Lock an open file until it is closed, however the process ends; False if another has it.

    Raises:
        ConfigError: the system has no such locks, as Windows.
    """
    try:
        import fcntl
    except ImportError:
        raise ConfigError(
            f"{file.name}: needs a lock that this system has not; use Linux, macOS or WSL"
        ) from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
