"""Which places are right for each query frame."""

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self, TextIO

import numpy as np
from numpy.typing import NDArray

from placefield.errors import MapError, TruthError

_COLUMNS = ("query", "first", "last")
_ROUTE_COLUMNS = ("query", "route", "place")
_STEP = 6  # most places between the twins of consecutive places of one stretch


Near = Callable[[str, int], NDArray[np.int64]]
"""Returns the places near one that is given by its route and its number in it, ascending."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The right places of every query frame, as inclusive ranges of places.

    Row r says that query frame `query[r]` is right at places `first[r]` to `last[r]`. A query frame
    may have several rows; a frame without a row is off the route: no place is right for it.

    Attributes:
        queries: number of query frames, Q.
        query: query frame of each row, (R,) int64, each in [0, Q).
        first: first right place of each row, (R,) int64.
        last: last right place of each row, (R,) int64, `first <= last`.
        judged: (Q,) bool, whether the right places of a query frame are known, so that it is
            judged; None: all are.
    """

    queries: int
    query: NDArray[np.int64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    judged: NDArray[np.bool_] | None = None

    @classmethod
    def within(cls, queries: int, references: int, tolerance: int, every: int = 1) -> Self:
        """Return the truth by frame numbers: query frame i is right at places i ± `tolerance`.

        If only every n-th frame of the reference is a place, query frame i is right at the places j
        with |i/n - j| ≤ `tolerance`, and at the nearest place in any case. A query frame that is
        further than `tolerance` places from every frame of the reference is off the route.

        Args:
            queries: number of query frames.
            references: number of frames of the reference.
            tolerance: places, 0 or more.
            every: n, 1 or more.

        Raises:
            TruthError: the tolerance is negative.
        """
        if tolerance < 0:
            raise TruthError(f"tolerance {tolerance} is negative: give 0 or more places")
        query = np.arange(queries, dtype=np.int64)
        first = np.maximum(query - tolerance * every, 0)
        last = np.minimum(query + tolerance * every, references - 1)
        on_route = first <= last
        unthinned = cls(queries, query[on_route], first[on_route], last[on_route])
        return unthinned.thinned(references, every)

    @property
    def on_route(self) -> NDArray[np.bool_]:
        """Which query frames have at least one right place, (Q,) bool."""
        on_route = np.zeros(self.queries, dtype=np.bool_)
        on_route[self.query] = True
        return on_route

    def thinned(self, references: int, every: int) -> Self:
        """Return the truth if only every n-th frame of the reference is a place.

        The right places of a row are those in [first/n, last/n]. If there is none, the nearest
        place is right, or both places that are equally near.

        Args:
            references: number of frames of the reference, which are the places of this truth.
            every: n, 1 or more: reference frame j n becomes place j.
        """
        lower, upper = -(-self.first // every), self.last // every
        # If no place is in the range, upper is the place before it, and lower the one after it.
        empty = lower > upper
        before = self.first - upper * every
        behind = lower * every - self.last
        is_last = lower * every >= references
        return replace(
            self,
            first=np.where(empty & (is_last | (before <= behind)), upper, lower),
            last=np.where(empty & ~is_last & (behind <= before), lower, upper),
        )

    def shared(self, same: NDArray[np.int32]) -> Self:
        """Return the truth on a map with places that are the same: a place is right in every lap.

        The places that are the same as those of a row are right, too, and so are places between
        them in another lap.

        Args:
            same: the place that each place is the same as, (K,) int32, see ``Places``.
        """
        if np.array_equal(same, np.arange(len(same))):
            return self
        order = np.argsort(same, kind="stable")
        ascending = same[order]
        rows = []
        for query, first, last in zip(self.query, self.first, self.last, strict=True):
            twins = same[first : last + 1]
            rows.append((query, first, last))
            for stretch in np.split(twins, np.flatnonzero(np.abs(np.diff(twins)) > _STEP) + 1):
                begin = np.searchsorted(ascending, stretch.min())
                end = np.searchsorted(ascending, stretch.max(), side="right")
                places = np.sort(order[begin:end])
                for lap in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1):
                    rows.append((query, lap[0], lap[-1]))
        query, first, last = np.array(rows, dtype=np.int64).reshape(-1, len(_COLUMNS)).T
        return replace(self, query=query, first=first, last=last)

    def correct(self, matches: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which matches are right.

        Args:
            matches: place of each query frame, (Q,) int; -1 is unanswered and never right.

        Returns:
            (Q,) bool.

        Raises:
            TruthError: there is not one match per query frame.
        """
        if matches.shape != (self.queries,):
            raise TruthError(
                f"the ground truth is for {self.queries} query frames, "
                f"the matches have shape {matches.shape}: give one match per query frame"
            )
        place = matches[self.query]
        hit = (self.first <= place) & (place <= self.last)
        correct = np.zeros(self.queries, dtype=np.bool_)
        correct[self.query[hit]] = True
        return correct

    def along(self, frames: NDArray[np.int64], foreign: NDArray[np.bool_]) -> Self:
        """Return the truth of a resampled traverse of the query.

        A frame of the traverse is right where its query frame is; a foreign frame is off the route.

        Args:
            frames: query frame of each frame of the traverse, (D,) int64; ignored where foreign.
            foreign: whether the frame is one of another route, (D,) bool.

        Raises:
            TruthError: a frame that is not foreign is not one of the query.
        """
        own = frames[~foreign]
        if np.any((own < 0) | (own >= self.queries)):
            raise TruthError(
                f"the drive takes frames {own.min()} to {own.max()}, the ground truth is for "
                f"{self.queries} query frames: give the truth of that query"
            )
        rows: list[list[int]] = [[] for _ in range(self.queries)]
        for row, query in enumerate(self.query):
            rows[query].append(row)
        pairs = [(at, row) for at in np.flatnonzero(~foreign) for row in rows[frames[at]]]
        position, row_of = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        judged = self.judged
        if judged is not None:
            judged = judged[np.where(foreign, 0, frames)] | foreign
        return type(self)(len(frames), position, self.first[row_of], self.last[row_of], judged)


def read_truth(path: Path, queries: int, places: int, near: Near | None = None) -> Truth:
    """Read a ground truth from a CSV file.

    With the columns `query`, `first` and `last`, each row gives an inclusive range of right places
    for one query frame. With `query`, `route` and `place`, a row names one place of a map of
    routes, and the places near it are right, too. A query frame may have several rows; one without
    a row is off the route. Blank lines and other columns are ignored.

    Args:
        path: the CSV file, UTF-8.
        queries: number of query frames.
        places: number of places of the map.
        near: returns the right places, given a route and the number of a place in it; None where
            no routes are known.

    Raises:
        TruthError: the file cannot be read, lacks a column, or holds a row that is not three
            integers, ends before it begins, or lies beyond the query frames or the places.

    """
    try:
        # utf-8-sig: spreadsheets put a byte order mark in front of the header.
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(_rows(file, path, (queries, places), near))
    except OSError as error:
        raise TruthError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise TruthError(f"{path}: is not a CSV file in UTF-8: {error}") from error
    query, first, last = np.array(rows, dtype=np.int64).reshape(-1, len(_COLUMNS)).T
    return Truth(queries, query, first, last)


def _rows(
    file: TextIO, path: Path, sizes: tuple[int, int], near: Near | None
) -> Iterator[tuple[int, int, int]]:
    queries, places = sizes
    reader = csv.DictReader(file, skipinitialspace=True)
    columns = reader.fieldnames or ()
    by_route = near is not None and all(column in columns for column in _ROUTE_COLUMNS)
    missing = [column for column in _COLUMNS if column not in columns]
    if missing and not by_route:
        raise TruthError(
            f"{path}:1: no column {', '.join(missing)}: the header must be {','.join(_COLUMNS)}, "
            f"or {','.join(_ROUTE_COLUMNS)} for a map of routes"
        )
    for row in reader:
        try:
            query = _query(row, queries)
            if near is not None and by_route:
                right = near(row["route"] or "", _integer("place", row["place"]))
                yield from ((query, first, last) for first, last in _ranges(right))
            else:
                yield query, *_parse(row, places)
        except (ValueError, MapError) as error:
            raise TruthError(f"{path}:{reader.line_num}: {error}") from error


def _query(row: dict[str, str | None], queries: int) -> int:
    query = _integer("query", row["query"])
    if not 0 <= query < queries:
        raise ValueError(f"query {query} is not one of the {queries} query frames (from 0)")
    return query


def _ranges(places: NDArray[np.int64]) -> Iterator[tuple[int, int]]:
    """Yield the inclusive ranges of consecutive places; the places ascend."""
    for run in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1):
        yield int(run[0]), int(run[-1])


def _parse(row: dict[str, str | None], places: int) -> tuple[int, int]:
    first, last = (_integer(column, row[column]) for column in ("first", "last"))
    if first > last:
        raise ValueError(f"first {first} is after last {last}")
    for column, place in (("first", first), ("last", last)):
        if not 0 <= place < places:
            raise ValueError(f"{column} {place} is not one of the {places} places (from 0)")
    return first, last


def _integer(column: str, text: str | None) -> int:
    try:
        return int(text or "")
    except ValueError:
        raise ValueError(f"{column} {text or ''!r} is not an integer") from None
