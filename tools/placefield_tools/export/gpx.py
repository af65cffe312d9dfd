"""Trajectories as GPX tracks."""

from datetime import UTC, datetime, timedelta

from gpxpy.gpx import GPX, GPXTrack, GPXTrackPoint, GPXTrackSegment

from placefield_tools.export.matched_traverse import QueryTraverse

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def to_gpx(traverse: QueryTraverse) -> str:
    """Write one track of all matches, with their stamps in microseconds.

    Raises:
        MapError: the map is not georeferenced.
    """
    points = [
        GPXTrackPoint(
            latitude,
            longitude,
            time=_EPOCH + timedelta(microseconds=localised.header.stamp_ns // 1000),
            name=f"place {localised.match.place}",
        )
        for (latitude, longitude), localised in zip(
            traverse.geographic_positions(), traverse.matches, strict=True
        )
    ]
    # The name of a stream comes from the bus, and may hold characters that XML does not allow.
    track = GPXTrack(name=repr(traverse.matches[0].header.stream).strip("'"))
    track.segments.append(GPXTrackSegment(points))
    gpx = GPX()
    gpx.creator = "placefield"
    gpx.tracks.append(track)
    return gpx.to_xml()
