"""The interface of all recorders."""

from collections.abc import Callable
from dataclasses import dataclass

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage


def _no_pictures(header: Header, jpeg: bytes) -> None:
    raise NotImplementedError("this kind of recording holds no images")


def _no_places(header: Header, jpeg: bytes) -> None:
    pass


@dataclass(frozen=True)
class Recorder:
    """Writes a recording to one file.

    Attributes:
        write_match: called with the header and the match; the match is None at the end of a stream.
        write_frame: called with the header and a small JPEG image of a query frame.
        write_place: called with the header and a JPEG image of the frame's place, if these are
            wanted; by default they are left out.
    """

    write_match: Callable[[Header, MatchMessage | None], None]
    write_frame: Callable[[Header, bytes], None] = _no_pictures
    write_place: Callable[[Header, bytes], None] = _no_places

    @property
    def has_pictures(self) -> bool:
        """Whether it records images of frames."""
        return self.write_frame is not _no_pictures
