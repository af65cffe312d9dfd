"""A ground truth by GPS: right for a query frame is every place that is near enough to it.

A street that the reference takes twice is right both times, which makes several runs of places.
"""

import logging
import math
from pathlib import Path

import numpy as np
import pymap3d  # type: ignore[import-untyped]
from numpy.typing import NDArray

from placefield.errors import SourceError
from placefield_tools.datasets.benchmarks import TRUTH, Benchmark
from placefield_tools.datasets.ground_truth import runs, write_runs
from placefield_tools.sources import open_source

log = logging.getLogger(__name__)

_NO_FIX = (math.nan, math.nan)
_SHOWN = 60  # characters of a line that is no position


def write_gps_truth(benchmark: Benchmark, folder: Path, metres: float) -> tuple[int, int]:
    """Write the ground truth of a benchmark's study into its folder, as ``TRUTH``.

    Args:
        benchmark: one whose truth is by GPS.
        folder: in which it lies.
        metres: how far off a right place is at most.

    Returns:
        How many query frames have a right place, and how many there are. The others have no row:
        ``--truth`` takes them to be off the route, where whatever is claimed is wrong.

    Raises:
        SourceError: positions or frames are missing, a file of positions is none, or no query frame
            has a right place.
        OSError: it cannot be written.
    """
    reference, query = (
        _of_frames(folder / traverse, folder / positions)
        for traverse, positions in benchmark.gps_files
    )
    rows = runs_within(query, reference, metres)
    placed = len({at for at, _, _ in rows})
    if placed == 0:
        raise SourceError(
            f"{folder}: no frame of the query is within {metres:g} m of the reference, by "
            f"{benchmark.gps_files[1][1]}; are these drives of one route?"
        )
    write_runs(rows, folder / TRUTH)
    return placed, len(query)


def runs_within(
    query: NDArray[np.float64], reference: NDArray[np.float64], metres: float
) -> list[tuple[int, int, int]]:
    """Give the runs of reference frames that are near enough to each query frame.

    Distances are over ground, in the plane that touches WGS 84 amid the reference (pymap3d's ENU).

    Args:
        query: latitude and longitude of the query's frames, degrees, (Q, 2); NaN: not known.
        reference: of the reference's, (K, 2).
        metres: how far off a right place is at most.

    Returns:
        Query frame, first and last reference frame of every run. A query frame may have many; one
        whose position is not known has none.
    """
    if not (np.isfinite(query).any() and np.isfinite(reference).any()):
        return []
    origin = np.nanmean(reference, axis=0)
    here, there = _on_plane(query, origin), _on_plane(reference, origin)
    return list(runs(np.hypot(*(there - at).T) <= metres for at in here))


def between_fixes(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give every frame a position of its own, where a receiver has fewer fixes than a film frames.

    A fix holds for the first of the frames that repeat it, and those between it and the next fix
    lie on the straight line between the two, evenly. The last fix stays as it is.

    Args:
        positions: latitude and longitude, degrees, (N, 2); NaN: not known.

    Returns:
        The same with what repeats spread, (N, 2); what was not known is not known.
    """
    known = np.isfinite(positions).all(axis=1)
    if not known.any():
        return positions
    before = np.vstack([np.full((1, 2), np.nan), positions[:-1]])
    fixes = np.flatnonzero(known & (positions != before).any(axis=1))
    frames = np.arange(len(positions))
    spread = np.stack([np.interp(frames, fixes, column[fixes]) for column in positions.T], axis=1)
    spread[~known] = np.nan
    return spread


def read_positions(path: Path) -> NDArray[np.float64]:
    """Read a file that has ``latitude,longitude`` of every frame on a line, in degrees.

    A blank line, ``0,0`` and NaN say that there was no fix. Latitudes without their minus, as in
    fGPS.txt, are left so: that mirrors the route at the equator and changes no distance.

    Returns:
        (N, 2); NaN where there was no fix.

    Raises:
        SourceError: it cannot be read, a line is none of these, or there is no fix at all.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise SourceError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SourceError(f"{path}: is no text; get it again") from None
    positions = np.array(
        [_position(path, number, line) for number, line in enumerate(lines, 1)]
    ).reshape(-1, 2)
    if not np.isfinite(positions).any():
        raise SourceError(f"{path}: has no fix of any frame; get it again")
    return positions


def _position(path: Path, number: int, line: str) -> tuple[float, float]:
    if not line.strip():
        return _NO_FIX
    try:
        latitude, longitude = map(float, line.split(","))
    except ValueError:
        latitude, longitude = math.inf, math.inf
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise SourceError(
            f"{path}:{number}: {line[:_SHOWN]!r} is not latitude,longitude in degrees; "
            "get the file again"
        )
    no_fix = latitude == longitude == 0 or math.isnan(latitude) or math.isnan(longitude)
    return _NO_FIX if no_fix else (latitude, longitude)


def _of_frames(traverse: Path, path: Path) -> NDArray[np.float64]:
    """Return where every frame is, (N, 2); lines and frames are taken together from the first."""
    positions = between_fixes(read_positions(path))
    with open_source(str(traverse)) as source:
        count = source.count or len(positions)
    if count != len(positions):
        log.warning(
            "%s: has %d lines for the %d frames of %s; line i is taken for frame i from the "
            "first on, what is over is left out",
            path,
            len(positions),
            count,
            traverse.name,
        )
    placed = np.full((count, 2), np.nan)
    common = min(count, len(positions))
    placed[:common] = positions[:common]
    return placed


def _on_plane(degrees: NDArray[np.float64], origin: NDArray[np.float64]) -> NDArray[np.float64]:
    east, north, _ = pymap3d.geodetic2enu(*degrees.T, 0.0, *origin, 0.0)
    return np.stack([east, north], axis=1)
