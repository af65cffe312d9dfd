"""Write where a recording was made, as GeoJSON for any program of maps.

    python examples/recording_to_geojson.py route.pfmap drive.mcap drive.geojson

The recording needs no positions, only images: a bag, an MCAP file, a video or a folder. The map has
them, of a reference drive with GPS. The same with the services is ``placefield record`` and
``placefield export``.
"""

import json
import sys
from pathlib import Path

from placefield import Recognizer, SmoothedMatch, open_map
from placefield.maps.geography import Origin
from placefield_tools.sources import open_source


def main(route: str, recording: str, geojson: str) -> None:
    """Match the recording, and write a point for each frame whose place is known."""
    placemap = open_map(Path(route))
    origin = Origin.of_frame(placemap.pose_frame)
    if origin is None:
        sys.exit(f"{route}: is not georeferenced; build it of frames with latitude and longitude")
    recognizer = Recognizer(placemap)
    smoothed: list[SmoothedMatch] = []
    with open_source(recording) as frames:
        for frame in frames:
            recognizer.update(frame.image, frame.odometry_m)
            smoothed += recognizer.smoothed()
    smoothed += recognizer.finish()
    points = [point for each in smoothed if (point := _point(each, origin)) is not None]
    written = {"type": "FeatureCollection", "features": points}
    Path(geojson).write_text(json.dumps(written))
    print(f"{len(points)} of {len(smoothed)} frames are known: {geojson}")


def _point(smoothed: SmoothedMatch, origin: Origin) -> dict[str, object] | None:
    match = smoothed.match
    if not match.known or match.pose is None:
        return None
    latitude, longitude = origin.to_degrees(*match.pose[:2])
    return {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [longitude, latitude]},
        "properties": {"frame": smoothed.frame, "place": match.place},
    }


if __name__ == "__main__":
    main(*sys.argv[1:])
