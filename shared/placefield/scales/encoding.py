"""From clusters to active segments and their scales (encoding rules 1 and 2, Eq. 4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.maps.route_graph import ONE_ROUTE, Firsts


@dataclass(frozen=True)
class Encoding:
    """The active segments of a traverse of K frames.

    Attributes:
        labels: (K,) int32, the number of the frame's active segment, from 1 on in route order; 0
            for the frames of all inactive segments.
        segments: (S, 2) int32, first frame and one past the last of each active segment.
        scales: (n,) int32, the distinct lengths of the active segments in frames, ascending.
    """

    labels: NDArray[np.int32]
    segments: NDArray[np.int32]
    scales: NDArray[np.int32]

    @property
    def active(self) -> float:
        """Fraction of the frames that lie in active segments."""
        return float((self.labels > 0).mean())


def encode(
    clusters: NDArray[np.integer],
    min_scale: float,
    travelled: NDArray[np.floating] | None = None,
    first: Firsts = ONE_ROUTE,
) -> Encoding:
    """Divide a traverse into active and inactive segments.

    A segment is a run of consecutive frames of one cluster, in one route. A segment shorter than
    the lower limit is inactive (rule 1); every other one is active and has its own label (rule 2).

    Args:
        clusters: (K,) cluster of each frame in route order, K >= 1.
        min_scale: the lower limit, above 0: in metres if `travelled` is given, else in frames.
        travelled: (K,) metres travelled up to each frame. A segment's length is then the distance
            between its first and last frame, plus the traverse's mean spacing for the gap to the
            next segment; lengths are compared to the millimetre.
        first: (R,) int32, the first frame of each route.
    """
    changes = np.union1d(np.flatnonzero(np.diff(clusters)) + 1, first[1:])
    segments = np.column_stack([np.r_[0, changes], np.r_[changes, len(clusters)]])
    frames = np.diff(segments, axis=1)[:, 0]
    lengths = frames if travelled is None else _metres(segments, travelled)

    active = lengths >= min_scale
    labels = np.repeat(np.where(active, np.cumsum(active), 0), frames)
    return Encoding(
        labels.astype(np.int32),
        segments[active].astype(np.int32),
        np.unique(frames[active]).astype(np.int32),
    )


def smallest_scale(min_scale: float, travelled: NDArray[np.floating] | None = None) -> int:
    """Return the smallest scale of all channels in frames, set by the lower limit of rule 1.

    Args:
        min_scale: the lower limit, as in `encode`.
        travelled: (K,) metres travelled up to each frame, if the limit is in metres. The scale is
            then the number of frames that reach it at the traverse's mean spacing.

    Returns:
        At least 1, and at most the number of frames.
    """
    if travelled is None:
        return round(min_scale)
    lengths = np.round(_mean_spacing(travelled) * np.arange(1, len(travelled) + 1), 3)
    return min(int(np.searchsorted(lengths, min_scale)) + 1, len(travelled))


def _mean_spacing(travelled: NDArray[np.floating]) -> float:
    return float(travelled[-1] - travelled[0]) / max(len(travelled) - 1, 1)


def _metres(segments: NDArray[np.integer], travelled: NDArray[np.floating]) -> NDArray[np.float64]:
    metres = travelled.astype(np.float64)
    spacing = _mean_spacing(metres)
    first, last = segments[:, 0], segments[:, 1] - 1
    lengths: NDArray[np.float64] = np.round(metres[last] - metres[first] + spacing, 3)
    return lengths
