"""The client gives the recognizer's own matches, through real services."""

from pathlib import Path

from hosting import Host

import placefield
from placefield import Recognizer
from placefield.maps.map import Map


def test_the_client_gives_the_matches_of_the_recognizer(
    host: Host, route_map: Map, query_dir: Path
) -> None:
    files = sorted(query_dir.iterdir())
    recognizer = Recognizer(route_map)
    with placefield.connect(host.endpoint) as client:
        assert list(client.stream(files)) == [recognizer.update(file) for file in files]
