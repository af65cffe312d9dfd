"""The ground truth of a query's frames, and its source: a file, poses, or frame numbers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from placefield.errors import TruthError
from placefield.evaluation.pose_truth import pose_truth
from placefield.evaluation.protocols import Resampling
from placefield.evaluation.truth import Truth
from placefield.features.frames import Pose
from placefield.maps.geography import Origin
from placefield.maps.map import Map
from placefield_tools.common.natural_sort import counted

_ALIKE = 0.25  # of the longer drive: aligned drives may differ in length by this fraction

_REMEDY = (
    "give --truth FILE, or latitude and longitude on both sides; or say --aligned, if frame i "
    "shows place i all the same"
)
_SAME_FRAME = ", or --same-frame, if the poses of both sides are in the same metres"


@dataclass(frozen=True)
class TruthOptions:
    """The user's options for the ground truth, if no file of it is given.

    Attributes:
        tolerance: places.
        metres: largest distance of a right place, by the poses; None: ``tolerance`` is used.
        aligned: query frame i shows place i, whatever poses and counts say.
        same_frame: the poses of both sides share one coordinate frame, though not georeferenced.
    """

    tolerance: int
    metres: float | None = None
    aligned: bool = False
    same_frame: bool = False


@dataclass(frozen=True, eq=False)
class TruthSides:
    """A drive of D frames, and the map that it is matched against.

    Attributes:
        placemap: the map.
        references: number of frames of the reference.
        queries: number of frames of the query in its own order.
        drive: order of the frames.
        poses: D poses of the drive's frames, None where unknown.
        origin: georeference of these poses, if known.
        readings: D readings of the odometry, metres, None where unknown.
    """

    placemap: Map
    references: int
    queries: int
    drive: Resampling
    poses: Sequence[Pose | None]
    origin: Origin | None
    readings: Sequence[float | None]


@dataclass(frozen=True)
class TruthSource:
    """A ground truth and its source.

    Attributes:
        truth: of the drive's frames; None if unknown.
        by: a given file or function, the poses of both sides, or the frame numbers.
        tolerance: in places, if it is in places.
        metres: tolerance in metres, if it is in metres.
        why_none: the reason, if there is no truth.
    """

    truth: Truth | None
    by: Literal["given", "poses", "aligned", "none"]
    tolerance: int | None = None
    metres: float | None = None
    why_none: str = ""

    @property
    def unjudged(self) -> int:
        """Number of frames without a ground truth."""
        judged = None if self.truth is None else self.truth.judged
        return 0 if judged is None else int(np.count_nonzero(~judged))

    def figures(self) -> dict[str, Any]:
        """Return the source of the truth for a JSON object."""
        figures: dict[str, Any] = {"by": self.by}
        if self.by == "poses":
            figures |= {"metres": self.metres, "unjudged": self.unjudged}
        return figures | ({"why": self.why_none} if self.truth is None else {})

    @property
    def line(self) -> str:
        """The source of the truth in one line of text."""
        within = f"{self.tolerance} places" if self.metres is None else f"{self.metres:g} m"
        if self.by == "poses":
            but = f"; {counted(self.unjudged, 'frame')} not judged" if self.unjudged else ""
            return f"right by the poses of both sides, within {within}{but}"
        if self.by == "aligned":
            return f"right by number: frame i of the query at place i, within {within}"
        return (
            f"NO VERDICT: {self.why_none}"
            if self.truth is None
            else "right by the ground truth that was given"
        )


def find_truth(
    comparison: TruthSides, truth_of: Callable[[], Truth], asked: TruthOptions | None
) -> TruthSource:
    """Find the ground truth of a drive.

    It comes from the poses of both sides, if they are georeferenced or share a frame by option.
    Otherwise frame i is taken to show place i, if there are as many frames as places, and both
    drives are equally long, as far as that is known.

    Args:
        comparison: of the drive with the map.
        truth_of: gives the truth by frame number or by a file, for the query in its own order.
        asked: the user's options; None: ``truth_of`` decides.

    Raises:
        TruthError: ``truth_of`` raises it, or the options need poses that cannot be compared.
    """
    if asked is None:
        return TruthSource(_by_number(comparison, truth_of), "given")
    if not asked.aligned:
        if (query := _in_frame_of_map(comparison, asked)) is not None:
            truth = _by_poses(comparison, query, asked)
            if truth.judged is not None and truth.judged.any():
                tolerance = asked.tolerance if asked.metres is None else None
                return TruthSource(truth, "poses", tolerance, asked.metres)
        _refuse_without_poses(comparison, asked)
        if why := _unaligned(comparison):
            more = (
                _SAME_FRAME if _have_poses(comparison) and not _is_georeferenced(comparison) else ""
            )
            return TruthSource(None, "none", why_none=f"{why}; {_REMEDY}{more}")
    return TruthSource(_by_number(comparison, truth_of), "aligned", asked.tolerance)


def _by_number(comparison: TruthSides, truth_of: Callable[[], Truth]) -> Truth:
    truth = truth_of().shared(comparison.placemap.places.same)
    return truth.along(comparison.drive.frames, comparison.drive.foreign)


def _by_poses(comparison: TruthSides, query: NDArray[np.float64], asked: TruthOptions) -> Truth:
    places = comparison.placemap.places
    query[comparison.drive.foreign] = np.nan  # the other route has another coordinate frame
    truth = pose_truth(
        query, places.poses[:, :2], tolerance=asked.tolerance, metres=asked.metres
    ).shared(places.same)
    if truth.judged is not None:
        truth.judged[comparison.drive.foreign] = truth.judged.any()
    return truth


def _in_frame_of_map(comparison: TruthSides, asked: TruthOptions) -> NDArray[np.float64] | None:
    """Return x and y of the drive's frames in the map's coordinates, (D, 2); None if unknown."""
    if not _have_poses(comparison):
        return None
    nowhere = (np.nan, np.nan)
    there = [nowhere if pose is None else (pose.x, pose.y) for pose in comparison.poses]
    origin = Origin.of_frame(comparison.placemap.pose_frame)
    if origin is None and comparison.origin is None and asked.same_frame:
        return np.array(there)
    if origin is None or comparison.origin is None:
        return None
    if origin == comparison.origin:
        return np.array(there)
    return np.array(
        [
            at if np.isnan(at[0]) else origin.to_local(*comparison.origin.to_degrees(*at))
            for at in there
        ]
    )


def _have_poses(comparison: TruthSides) -> bool:
    return bool(len(comparison.placemap.places.poses)) and any(comparison.poses)


def _is_georeferenced(comparison: TruthSides) -> bool:
    """Return whether the poses of at least one side are georeferenced."""
    return bool(comparison.origin or Origin.of_frame(comparison.placemap.pose_frame))


def _refuse_without_poses(comparison: TruthSides, asked: TruthOptions) -> None:
    """Refuse options that need poses of both sides, if these are missing or not comparable."""
    flag = f"--tolerance {asked.metres:g}m" if asked.metres is not None else "--same-frame"
    if asked.metres is None and not asked.same_frame:
        return
    if not _have_poses(comparison):
        side = "query" if len(comparison.placemap.places.poses) else "reference"
        raise TruthError(f"{flag}: needs poses on both sides, and the {side} has none")
    if _is_georeferenced(comparison):
        raise TruthError(
            f"{flag}: only the poses of one side are georeferenced: "
            "give latitude and longitude on both sides"
        )
    raise TruthError(
        f"{flag}: the poses of both sides are not georeferenced: say --same-frame, if both are in "
        "the same metres"
    )


def _unaligned(comparison: TruthSides) -> str | None:
    """Return why frame i does not show place i; None if nothing speaks against it."""
    if comparison.queries != comparison.references:
        frames = counted(comparison.queries, "frame")
        return f"the query has {frames}, and the reference {comparison.references}"
    is_whole = np.array_equal(comparison.drive.frames, np.arange(comparison.queries))
    travelled = comparison.placemap.places.travelled
    if not is_whole or not len(travelled):
        return None
    first, last = comparison.readings[0], comparison.readings[-1]
    if first is None or last is None:
        return None
    way, reference = last - first, float(travelled[-1] - travelled[0])
    if abs(way - reference) <= _ALIKE * max(way, reference):
        return None
    return f"the query is {way:.0f} m long, and the reference {reference:.0f} m"
