"""Recordings as Rerun writes them. A file that was cut off lacks only its last moments."""

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import BinaryIO, TypeVar

import numpy as np
import rerun as rr

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield.maps.geography import Origin
from placefield_tools.record.recorder import Recorder
from placefield_tools.record.records import kind_of
from placefield_tools.record.rerun_blueprint import blueprint

_PIECE = 2**16  # bytes
_NUMBERS = ("place", "score", "probability", "known", "too_fast", "lag", "inliers", "ratio")

What = TypeVar("What")


@contextmanager
def record_rerun(
    path: Path, origin: Origin | None, *, frames: bool, precision: float
) -> Iterator[Recorder]:
    """Record every match as numbers over time, and the position of every known match.

    Besides Rerun's own timeline, there are one of stamps and one of frame numbers. The file has a
    layout, see ``blueprint``.

    Args:
        path: of the file.
        origin: georeference of the map; None: no positions on the earth.
        frames: whether there will be images of the query frames, for the layout.
        precision: the probability from which on a match is known, to draw it beside each
            probability.
    """
    stream = rr.RecordingStream("placefield")

    def set_time(header: Header) -> None:
        stream.set_time("stamp", timestamp=np.datetime64(header.stamp_ns, "ns"))
        stream.set_time("frame", sequence=header.sequence)

    def write_match(header: Header, match: MatchMessage | None) -> None:
        set_time(header)
        if match is None:
            end = f"end of stream {header.stream}: {header.sequence} frames"
            stream.log("stream", rr.TextLog(end))
            return
        kind = kind_of(match)
        root = "" if kind == "causal" else f"{kind}/"
        for name in _NUMBERS:
            value = getattr(match, name, None)
            if value is not None:
                stream.log(f"{root}match/{name}", rr.Scalars(float(value)))
        if match.probability is not None and kind == "causal":
            stream.log("match/asked", rr.Scalars(precision))
        if match.pose is None or match.known is False:
            return
        x, y, _ = match.pose
        stream.log(f"{root}route/position", rr.Points3D([[x, y, 0.0]]))
        if origin is not None:
            stream.log(f"{root}earth/position", rr.GeoPoints(lat_lon=[origin.to_degrees(x, y)]))

    def write_image(entity: str, header: Header, jpeg: bytes) -> None:
        set_time(header)
        stream.log(entity, rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))

    with path.open("xb") as file:
        copying = _Copying(file)
        stream.save(copying.way_in)
        copying.begin()
        layout = blueprint(georeferenced=origin is not None, frames=frames)
        # Only now: it fills the pipe, and Rerun would wait for a reader.
        stream.send_blueprint(layout, make_active=False)
        try:
            yield Recorder(
                copying.after(write_match),
                copying.after(partial(write_image, "frame")),
                copying.after(partial(write_image, "place")),
            )
        finally:
            stream.disconnect()
            copying.end()


class _Copying:
    """Copies Rerun's output into a file through a pipe, because Rerun hides errors of the disk."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._out, self._in = os.pipe()
        self.way_in = f"/proc/self/fd/{self._in}"
        self._error: OSError | None = None
        self._thread = threading.Thread(target=self._copy, daemon=True)

    def begin(self) -> None:
        """Begin, after Rerun has opened the pipe; the copying ends when Rerun closes it."""
        os.close(self._in)
        self._thread.start()

    def after(self, write: Callable[[Header, What], None]) -> Callable[[Header, What], None]:
        """Return a function that writes, and raises ``OSError`` if the copying has failed."""

        def call(header: Header, what: What) -> None:
            write(header, what)
            self._check()

        return call

    def end(self) -> None:
        """Wait until everything is copied.

        Raises:
            OSError: the copying has failed.
        """
        self._thread.join()
        self._check()

    def _check(self) -> None:
        if self._error is not None:
            raise OSError(self._error.errno, self._error.strerror)

    def _copy(self) -> None:
        with os.fdopen(self._out, "rb", buffering=0) as out:
            while piece := out.read(_PIECE):
                try:
                    if self._error is None:
                        self._file.write(piece)
                        self._file.flush()
                except OSError as error:  # read on, so that Rerun does not block
                    self._error = error
