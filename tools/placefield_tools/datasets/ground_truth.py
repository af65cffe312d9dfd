"""Converting a benchmark's own ground truth to the table that ``--truth`` reads."""

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from placefield.errors import SourceError
from placefield.files import written_whole

_MATRIX = "GTsoft"
"""The matrix of right places: all places that show the query's scene, not only the nearest one."""


def write_truth(matrix: Path, table: Path) -> None:
    """Write the runs of right places of every query frame as ``query,first,last``.

    Args:
        matrix: a NumPy archive whose ``GTsoft``, (places, queries) of any number type, is not 0
            where a place is right for a query frame.
        table: path of the table.

    Raises:
        SourceError: there is no such matrix.
        OSError: the table cannot be written.
    """
    try:
        with np.load(matrix, allow_pickle=False) as arrays:
            right = np.asarray(arrays[_MATRIX] != 0)
    except (OSError, ValueError, KeyError, TypeError, BadZipFile) as error:
        raise SourceError(f"{matrix}: holds no matrix {_MATRIX} ({error})") from None
    if right.ndim != 2:
        raise SourceError(f"{matrix}: {_MATRIX} has shape {right.shape}, not (places, queries)")
    write_runs(runs(right.T), table)


def runs(right: Iterable[NDArray[np.bool_]]) -> Iterator[tuple[int, int, int]]:
    """Yield the runs of right places of every query frame as query, first and last.

    Args:
        right: for each query frame which places are right, (K,) bool.
    """
    for query, places in enumerate(right):
        edges = np.flatnonzero(np.diff(places, prepend=False, append=False))
        yield from ((query, int(first), int(end) - 1) for first, end in edges.reshape(-1, 2))


def write_runs(rows: Iterable[tuple[int, int, int]], table: Path) -> None:
    """Write runs as ``query,first,last``, atomically.

    Raises:
        OSError: the table cannot be written.
    """
    with written_whole(table) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("query", "first", "last"))
        writer.writerows(rows)
