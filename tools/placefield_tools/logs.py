"""The log, on stderr: lines for a person, or JSON for a machine."""

import logging
import time

from pythonjsonlogger.json import JsonFormatter

log = logging.getLogger("placefield")


def log_for_a_person() -> None:
    """Log a line per message, with who says so."""
    logging.basicConfig(format="placefield: %(message)s", level=logging.INFO, force=True)


def log_as_json() -> None:
    """Log an object per line: ``time`` in UTC, ``level``, ``logger``, ``message``, ``process``."""
    formatter = JsonFormatter(
        ("asctime", "levelname", "name", "message", "process"),
        rename_fields={"asctime": "time", "levelname": "level", "name": "logger"},
        datefmt="%Y-%m-%dT%H:%M:%SZ",
    )
    formatter.converter = time.gmtime
    for handler in logging.getLogger().handlers:
        handler.setFormatter(formatter)
