"""The dashboard follows a new version of the map; seen over HTTP, without a browser."""

from dataclasses import replace
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import numpy as np
import pytest
from hosting import Host, Listener, Process, wait_until

from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.maps.manifest import read_identified
from placefield.maps.map import Map
from placefield.maps.store import save_map
from placefield_tools.common.host_process import free_endpoint

pytest.importorskip("nicegui", reason="the dashboard's extra is not installed")


def in_reverse(placemap: Map) -> Map:
    """Return a version of a map that has the thumbnails of its places in reverse."""
    places = placemap.places
    thumbnails = [places.thumbnail(place) for place in range(places.count)][::-1]
    ends = np.cumsum([len(each) for each in thumbnails], dtype=np.int64)
    joined = np.frombuffer(b"".join(thumbnails), np.uint8)
    return replace(placemap, places=replace(places, thumbnails=joined, thumbnail_ends=ends))


def test_the_dashboard_shows_a_new_version_from_its_first_match_on(
    host: Host, listener: Listener, logs: Path, route_map: Map, tmp_path: Path
) -> None:
    path, port = tmp_path / "route.pfmap", free_endpoint().rpartition(":")[2]
    save_map(route_map, path)
    matches = listener.bus.publisher(Keys("own").match)
    first, last = (route_map.places.thumbnail(place) for place in (0, route_map.places.count - 1))
    assert first != last

    def picture(of: str) -> bytes:
        try:
            with urlopen(f"http://127.0.0.1:{port}/{of}") as answer:
                return bytes(answer.read())
        except HTTPError:
            return b""

    def put(sequence: int) -> None:
        """Publish a match of the version at the path."""
        digest = read_identified(path)[1]
        header = Header(stream="s", sequence=sequence, stamp_ns=sequence)
        matches.put(header, MatchMessage(map=digest, place=0, score=0.0))

    flags = ("--run", "own", "--endpoint", host.endpoint, "--port", port)
    with Process(logs, "dashboard", path, *flags) as process:
        wait_until(lambda: "ready" in process.out, "the dashboard is ready")
        put(0)
        wait_until(lambda: picture("distances/0.png"), "the match is shown")
        assert picture("place/0.jpg") == first
        save_map(in_reverse(route_map), path)
        frames = iter(range(1, 1000))

        def goes_over() -> bool:
            put(next(frames))
            return picture("place/0.jpg") == last

        wait_until(goes_over, "the new version is shown")
        assert not picture("distances/0.png"), "an answer of the old version is still there"
