"""The loops of a drive as a table: CSV or JSON, with a row for each frame.

A row has the frame that is the most likely place even if it is not known, so that a reader may
choose another probability to ask for.
"""

import csv
import io
import json
from collections.abc import Iterator
from typing import Any

from placefield.matching.candidate import UNANSWERED
from placefield.matching.exploring import Answer
from placefield_tools.loops.finding import DriveLoops

_KEYS = ("place", "place_stamp_ns", "probability", "new_probability", "known")


def to_csv(loops: DriveLoops) -> str:
    """Write a header, and a row for each frame; a place that does not exist is empty."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["frame", "stamp_ns", *_KEYS, *(f"smoothed_{key}" for key in _KEYS)])
    for frame, causal, smoothed in _rows(loops):
        table.writerow([*frame.values(), *_cells(causal), *_cells(smoothed)])
    return text.getvalue()


def to_json(loops: DriveLoops) -> str:
    """Write a list with an object for each frame; a place that does not exist is null."""
    rows = [
        {**frame, "causal": causal, "smoothed": smoothed}
        for frame, causal, smoothed in _rows(loops)
    ]
    return "[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n"


def _rows(loops: DriveLoops) -> Iterator[tuple[dict[str, int], dict[str, Any], dict[str, Any]]]:
    for frame, causal, smoothed in zip(loops.frames, loops.causal, loops.smoothed, strict=True):
        own = {"frame": frame.number, "stamp_ns": frame.stamp_ns}
        yield own, _values(loops, causal), _values(loops, smoothed)


def _values(loops: DriveLoops, answer: Answer) -> dict[str, Any]:
    place = None if answer.place == UNANSWERED else loops.frames[answer.place]
    values = (
        place and place.number,
        place and place.stamp_ns,
        round(answer.probability, 6),
        round(answer.new, 6),
        answer.known,
    )
    return dict(zip(_KEYS, values, strict=True))


def _cells(values: dict[str, Any]) -> list[Any]:
    return [int(value) if isinstance(value, bool) else value for value in values.values()]
