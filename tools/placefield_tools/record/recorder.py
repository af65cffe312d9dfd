"""What writes a recording."""

from collections.abc import Callable
from dataclasses import dataclass

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage


def _no_pictures(header: Header, jpeg: bytes) -> None:
    raise NotImplementedError("this kind of recording holds no pictures")


@dataclass(frozen=True)
class Recorder:
    """Writes to one file.

    Attributes:
        write_match: takes a match and its header; no match at the end of a stream.
        write_frame: takes a small picture of a query frame, JPEG, and its header.
    """

    write_match: Callable[[Header, MatchMessage | None], None]
    write_frame: Callable[[Header, bytes], None] = _no_pictures

    @property
    def has_pictures(self) -> bool:
        """Whether it writes pictures of frames."""
        return self.write_frame is not _no_pictures
