"""The query traverse to export: its matches, with the poses of their places."""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.bus.verified_messages import VerifiedMessage
from placefield.errors import MapError
from placefield.maps.digest import NO_DIGEST
from placefield.maps.map import Map
from placefield_tools.record.georeference import origin_of
from placefield_tools.record.records import Record, RecordingError

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Localised:
    """A match and the pose of its place: x and y in metres and yaw in radians."""

    header: Header
    match: MatchMessage
    pose: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class QueryTraverse:
    """One stream of matches on a map with K places.

    Attributes:
        matches: in order; at least one.
        places: (K, 3) float64, x and y in metres and yaw in radians, NaN where unknown.
        pose_frame: name of the poses' coordinate frame.
        map_path: of the map, used in errors.
        tolerance: a match is right within this many places.
    """

    matches: Sequence[Localised]
    places: NDArray[np.float64]
    pose_frame: str | None
    map_path: Path
    tolerance: int

    def geographic_positions(self) -> list[tuple[float, float]]:
        """Return latitude and longitude of each match, degrees.

        Raises:
            MapError: the map is not georeferenced.
        """
        origin = origin_of(self.pose_frame, self.map_path, "export to .tum or .g2o")
        return [origin.to_degrees(x, y) for x, y, _ in (match.pose for match in self.matches)]


def localise(
    records: Sequence[Record], placemap: Map, map_path: Path, *, tolerance: int, unknown: bool
) -> QueryTraverse:
    """Give known matches, or with ``unknown`` all matches of a place, the poses of their places.

    Matches at places of unknown pose are left out; their number is logged.

    Raises:
        MapError: the map has no poses, or is not the map of the recording.
        RecordingError: there is no such match, or no place of a match has a pose.
    """
    places = placemap.places
    if not len(places.poses):
        raise MapError(
            f"{map_path}: its places have no poses; build it of frames with poses, for example "
            "with x and y in a frames.csv"
        )
    matches, nowhere = [], 0
    for record in records:
        match = record.match
        if match.map not in (NO_DIGEST, placemap.digest):
            raise MapError(
                f"{map_path}: is the map {placemap.digest}, and the recording is of {match.map}; "
                "give the map that was matched against"
            )
        if match.place < 0 or not (match.known or unknown):
            continue
        pose = places.pose(match.place) if match.place < places.count else None
        if match.place >= places.count or match.pose not in (None, pose):
            raise MapError(
                f"{map_path}: place {match.place} has another pose than in the recording; give the "
                "map that was matched against"
            )
        if pose is None:
            nowhere += 1
            continue
        matches.append(Localised(record.header, match, pose))
    if nowhere:
        what = f"{nowhere} of {nowhere + len(matches)} matches are at places without a pose"
        if not matches:
            raise RecordingError(f"{map_path}: {what}: there is nothing to export")
        log.warning("%s: %s and are left out", map_path, what)
    if not matches:
        hint = "" if unknown else "; --all exports unknown matches, too"
        raise RecordingError(f"none of the {len(records)} matches is known{hint}")
    return QueryTraverse(matches, places.poses, placemap.pose_frame, map_path, tolerance)


def of_one_stream(records: Sequence[Record], path: Path, stream: str | None) -> list[Record]:
    """Return the records of the stream whose name begins with ``stream``; None: the only stream.

    A frame with a smoothed or verified match is represented by that match.

    Raises:
        RecordingError: there is no such stream, or more than one.
    """
    frames = dict.fromkeys((record.header.stream, record.header.sequence) for record in records)
    counts = Counter(name for name, _ in frames)
    chosen = [name for name in counts if stream is None or name.startswith(stream)]
    if stream is not None and stream in counts:
        chosen = [stream]
    if not counts:
        raise RecordingError(f"{path}: holds no matches")
    if len(chosen) != 1:
        begin = f"{len(chosen)} streams begin" if chosen else "no stream begins"
        what = "" if stream is None else f"{begin} with {stream!r}; "
        listed = ", ".join(f"{name[:8]} ({count} matches)" for name, count in counts.items())
        raise RecordingError(f"{path}: {what}name one of its streams with --stream: {listed}")
    return _best([record for record in records if record.header.stream == chosen[0]])


def _best(records: Sequence[Record]) -> list[Record]:
    """Return the best match of each frame: verified, else smoothed, else causal."""
    best: dict[int, Record] = {}
    for record in records:
        before = best.get(record.header.sequence)
        if before is None or _rank(record.match) >= _rank(before.match):
            best[record.header.sequence] = record
    return list(best.values())


def _rank(match: MatchMessage) -> int:
    return isinstance(match, SmoothedMessage) + isinstance(match, VerifiedMessage)
