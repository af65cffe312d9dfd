"""Images of the matched places in a recording, beside those of the query."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.errors import MapError
from placefield.features.images import small_jpeg
from placefield.maps.opening import open_map
from placefield_tools.record.recorder import Recorder
from placefield_tools.record.records import kind_of

_GREY = np.full((240, 320, 3), 128, np.uint8)


class PlacePictures:
    """The images of the places of a map, also of a version that replaces it."""

    def __init__(self, path: Path) -> None:
        """Open the map.

        Raises:
            MapError: it cannot be opened.
        """
        self._path = path
        self._map = open_map(path)
        self._seen = {self._map.digest}
        self._none = small_jpeg(_GREY, max(_GREY.shape))

    def of(self, match: MatchMessage) -> bytes:
        """Return the JPEG image of a match's place, or a grey one if there is none.

        There is none without a place, of a map without thumbnails, or of a version that has been
        replaced.
        """
        if match.map not in self._seen:
            self._seen.add(match.map)
            self._open_again()
        places = self._map.places
        if match.map != self._map.digest or not 0 <= match.place < places.count:
            return self._none
        return places.thumbnail(match.place) if places.has_thumbnails else self._none

    def _open_again(self) -> None:
        with suppress(MapError):  # it was removed: the images of the open version are still there
            self._map = open_map(self._path)


@contextmanager
def with_places(
    into: AbstractContextManager[Recorder], pictures: PlacePictures
) -> Iterator[Recorder]:
    """Record, after each match at once, the image of its place."""
    with into as recorder:

        def write_match(header: Header, match: MatchMessage | None) -> None:
            recorder.write_match(header, match)
            if match is not None and kind_of(match) == "causal":
                recorder.write_place(header, pictures.of(match))

        yield replace(recorder, write_match=write_match)
