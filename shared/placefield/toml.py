"""Reads TOML from files and messages."""

import tomllib
from typing import Any

from placefield.errors import ConfigError


def parse_toml(written: bytes, source: str) -> dict[str, Any]:
    """Parse TOML; ``source`` names its origin in errors.

    Raises:
        ConfigError: it is not TOML, is nested too deeply, or has a number of thousands of digits.
    """
    try:
        return tomllib.loads(written.decode())
    except RecursionError:
        raise ConfigError(f"{source}: not valid TOML: nested too deeply") from None
    except ValueError as error:  # of the parser, of UTF-8, or of a number that is too long
        why, _, _ = str(error).partition(";")
        raise ConfigError(f"{source}: not valid TOML: {why}") from None
