"""A ground truth by GPS: every place within a distance of the query frame is right.

If the reference passes a street twice, both passes are right: a frame has several runs of places.
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
        folder: of the benchmark.
        metres: largest distance of a right place.

    Returns:
        The number of query frames with a right place, and the number of query frames. The others
        have no row: ``--truth`` treats them as off the route, where every match is wrong.

    Raises:
        SourceError: positions or frames are missing, a file of positions is malformed, or no query
            frame has a right place.
        OSError: the file cannot be written.
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
            f"{benchmark.gps_files[1][1]}; check that both drives are of one route"
        )
    write_runs(rows, folder / TRUTH)
    return placed, len(query)


def runs_within(
    query: NDArray[np.float64], reference: NDArray[np.float64], metres: float
) -> list[tuple[int, int, int]]:
    """Return the runs of reference frames within a distance of each query frame.

    Distances are horizontal, in the tangent plane at the reference's mean (pymap3d's ENU, WGS 84).

    Args:
        query: latitude and longitude of the query's frames, degrees, (Q, 2); NaN if unknown.
        reference: likewise of the reference's frames, (K, 2).
        metres: largest distance of a right place.

    Returns:
        Query frame, first and last reference frame of every run. A query frame may have several
        runs; a frame of unknown position has none.
    """
    if not (np.isfinite(query).any() and np.isfinite(reference).any()):
        return []
    origin = np.nanmean(reference, axis=0)
    here, there = _on_plane(query, origin), _on_plane(reference, origin)
    return list(runs(np.hypot(*(there - at).T) <= metres for at in here))


def between_fixes(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate positions of frames that repeat a fix, because fixes are rarer than frames.

    A fix belongs to the first frame that has it. The positions of the frames up to the next fix are
    interpolated linearly. The last fix is kept.

    Args:
        positions: latitude and longitude, degrees, (N, 2); NaN if unknown.

    Returns:
        The interpolated positions, (N, 2); unknown positions stay unknown.
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
    """Read a file with one line ``latitude,longitude``, in degrees, per frame.

    A blank line, ``0,0`` and NaN mean that there was no fix. Latitudes without their minus sign, as
    in fGPS.txt, are not corrected: that mirrors the route at the equator and keeps all distances.

    Returns:
        (N, 2); NaN where there was no fix.

    Raises:
        SourceError: the file cannot be read, a line is malformed, or there is no fix at all.
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
    """Return the position of every frame, (N, 2); line i belongs to frame i."""
    positions = between_fixes(read_positions(path))
    with open_source(str(traverse)) as source:
        count = source.count or len(positions)
    if count != len(positions):
        log.warning(
            "%s: has %d lines for the %d frames of %s; line i is used for frame i, and the rest "
            "is left out",
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
