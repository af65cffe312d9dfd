"""Recorded matches: to objects for JSON and rows for CSV, and back."""

import csv
import json
import logging
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import ValidationError

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.bus.verified_messages import VerifiedMessage
from placefield.errors import PlacefieldError
from placefield.maps.digest import NO_DIGEST

log = logging.getLogger(__name__)

_HEADER = ("stream", "sequence", "stamp_ns")
_POSE = ("x", "y", "yaw")
_VERIFIED = ("inliers", "ratio", "reason")
COLUMNS = (
    *_HEADER,
    "place",
    "score",
    "probability",
    "known",
    "too_fast",
    *_POSE,
    "missing",
    "lag",
    "map",
    "forgotten",
    "new",
    *_VERIFIED,
)
"""The columns of a CSV file; only smoothed and verified matches have a lag."""


class RecordingError(PlacefieldError):
    """A recording of matches cannot be read or written."""


@dataclass(frozen=True, slots=True)
class Record:
    """A match and the header of its frame."""

    header: Header
    match: MatchMessage


def kind_of(match: MatchMessage | None) -> Literal["causal", "smoothed", "verified"]:
    """Return the kind of a match; the end of a stream, None, goes with the causal matches."""
    if isinstance(match, VerifiedMessage):
        return "verified"
    return "smoothed" if isinstance(match, SmoothedMessage) else "causal"


def as_object(header: Header, match: MatchMessage | None) -> dict[str, Any]:
    """Return the JSON object of a match; without a match, that of the end of a stream."""
    frame = {name: getattr(header, name) for name in _HEADER}
    kind = kind_of(match)
    frame |= {"end": header.end, "smoothed": kind == "smoothed", "verified": kind == "verified"}
    return frame | (match.model_dump(exclude={"version", "posterior"}) if match else {})


def as_row(header: Header, match: MatchMessage) -> dict[str, Any]:
    """Return the cells of a match by ``COLUMNS``; missing values are empty.

    ``known``, ``too_fast`` and ``forgotten`` are ``true`` or ``false``. The channels in ``missing``
    are separated by spaces.
    """
    row = {name: getattr(header, name) for name in _HEADER}
    row |= match.model_dump(include={"place", "score", "probability", "map", "new"})
    row["known"] = "" if match.known is None else str(match.known).lower()
    row |= {name: str(getattr(match, name)).lower() for name in ("too_fast", "forgotten")}
    row |= zip(_POSE, match.pose or ("", "", ""), strict=True)
    lag = match.lag if isinstance(match, SmoothedMessage) else ""
    if isinstance(match, VerifiedMessage):
        row |= match.model_dump(include=set(_VERIFIED))
    return row | {"missing": " ".join(map(str, match.missing)), "lag": lag}


def read_records(path: Path) -> list[Record]:
    """Read the matches of a recording, in order; the ends of streams are left out.

    An incomplete last line, which a killed recorder leaves, is left out and logged.

    Args:
        path: of a ``.jsonl`` or ``.csv`` file.

    Raises:
        RecordingError: the file is of another kind, or a line holds no match.
    """
    if path.suffix not in _PARSERS:
        raise RecordingError(f"{path}: give matches as 'placefield record' writes .jsonl or .csv")
    with path.open(newline="\n", encoding="utf-8") as file:  # a stream's name may hold \r
        lines = _WholeLines(file, path)
        try:
            parsed = [_record(fields) for fields in _PARSERS[path.suffix](lines)]
        except (ValueError, RecursionError, csv.Error) as error:
            why = f"not what 'placefield record' writes ({_first_line(error)})"
            raise RecordingError(f"{path}, line {lines.number}: {why}") from None
    return [record for record in parsed if record is not None]


class _WholeLines(Iterator[str]):
    """The complete lines of a file; ``number`` is the number of the newest line, from 1."""

    def __init__(self, lines: Iterable[str], path: Path) -> None:
        self._lines, self._path = iter(lines), path
        self.number = 0

    def __next__(self) -> str:
        line = next(self._lines)
        self.number += 1
        if not line.endswith("\n"):
            log.warning("%s: the last line was cut off and is left out", self._path)
            raise StopIteration
        return line


def _from_lines(lines: Iterable[str]) -> Iterator[dict[str, Any]]:
    for line in lines:
        try:
            fields = json.loads(line)
        except RecursionError:
            raise ValueError("nested too deeply") from None
        if not isinstance(fields, dict):
            raise ValueError("no JSON object")
        yield fields


def _from_rows(lines: Iterable[str]) -> Iterator[dict[str, Any]]:
    for row in csv.DictReader(lines, strict=True):
        cells = {name: cell for name, cell in row.items() if cell}
        pose = [cells.pop(axis) for axis in _POSE if axis in cells]
        missing = cells.pop("missing", "").split()
        yield cells | {"missing": missing} | ({"pose": pose} if pose else {})


_PARSERS: dict[str, Callable[[Iterable[str]], Iterator[dict[str, Any]]]] = {
    ".jsonl": _from_lines,
    ".csv": _from_rows,
}


def _record(fields: dict[str, Any]) -> Record | None:
    """Parse and check a match; all values of CSV are text. None at the end of a stream."""
    frame = {name: fields.pop(name) for name in (*_HEADER, "end") if name in fields}
    header = Header.model_validate(frame, strict=False)
    if header.end:
        return None
    fields.pop("smoothed", None)
    fields.pop("verified", None)
    fields.setdefault("map", NO_DIGEST)  # old recordings do not name the map
    kind: type[MatchMessage] = SmoothedMessage if "lag" in fields else MatchMessage
    if not fields.keys().isdisjoint(_VERIFIED):
        kind = VerifiedMessage
    return Record(header, kind.model_validate(fields, strict=False))


def _first_line(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors(include_url=False, include_context=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"]))
        return f"{where!r:.80}: {first['msg']}"
    return str(error).partition("\n")[0] or type(error).__name__
