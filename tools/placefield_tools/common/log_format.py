"""The log, on stderr: lines for a person, or JSON for a machine."""

import logging
import sys
import threading
import time
from types import TracebackType
from typing import TextIO

log = logging.getLogger("placefield")


class _Stderr(logging.StreamHandler[TextIO]):
    """Writes to the current ``sys.stderr``, which an embedding program may replace."""

    @property
    def stream(self) -> TextIO:
        return sys.stderr

    @stream.setter
    def stream(self, stream: TextIO) -> None: ...


def log_for_a_person() -> None:
    """Log a line of text per message, with the prefix ``placefield:``."""
    logging.basicConfig(format="placefield: %(message)s", handlers=[_Stderr()], force=True)
    for ours in ("placefield", "placefield_services", "placefield_tools"):
        logging.getLogger(ours).setLevel(logging.INFO)


def log_as_json() -> None:
    """Log an object per line: ``time`` in UTC, ``level``, ``logger``, ``message``, ``process``.

    Warnings and uncaught exceptions are objects, too; the latter have a traceback, ``exc_info``.
    """
    from pythonjsonlogger.json import JsonFormatter

    formatter = JsonFormatter(
        ("asctime", "levelname", "name", "message", "process"),
        rename_fields={"asctime": "time", "levelname": "level", "name": "logger"},
        datefmt="%Y-%m-%dT%H:%M:%SZ",
    )
    formatter.converter = time.gmtime
    for handler in logging.getLogger().handlers:
        handler.setFormatter(formatter)
    logging.captureWarnings(True)
    sys.excepthook = _log_defect
    threading.excepthook = lambda raised: _log_defect(*raised[:3])


def _log_defect(
    kind: type[BaseException], error: BaseException | None, trace: TracebackType | None
) -> None:
    if isinstance(error, Exception):
        log.critical("a defect", exc_info=(kind, error, trace))
