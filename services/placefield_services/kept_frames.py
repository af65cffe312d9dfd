"""The frames of a run that a verifier keeps until their matches are verified."""

from collections.abc import Container
from dataclasses import dataclass

from placefield.features.frames import Frame

FrameName = tuple[str, int]
"""The stream of a frame, and its number."""

MOST_BYTES = 2**29
"""The most bytes of the frames of a run."""

_OWN_BYTES = 1024  # of a frame besides its image, so that the number of frames is bounded, too


@dataclass(frozen=True, eq=False)
class KeptFrame:
    """A frame that waits for its match.

    Attributes:
        frame: an image or a descriptor.
        verifiers: identities of the verifiers that were alive when it came, and so have it, too.
    """

    frame: Frame
    verifiers: frozenset[str]

    @property
    def size(self) -> int:
        """How much of the bound it takes, bytes."""
        image, descriptor = self.frame.image, self.frame.descriptor
        held = len(image) if isinstance(image, bytes) else image.nbytes
        return _OWN_BYTES + held + (0 if descriptor is None else descriptor.nbytes)


class KeptFrames:
    """Frames by name; the oldest are dropped when there are too many bytes."""

    def __init__(self, most_bytes: int = MOST_BYTES) -> None:
        """Keep frames of at most ``most_bytes`` bytes."""
        self._most_bytes = most_bytes
        self._kept: dict[FrameName, KeptFrame] = {}
        self._bytes = 0

    def keep(self, name: FrameName, frame: KeptFrame) -> None:
        """Keep a frame; one that is kept already was sent again, and stays as it is."""
        if name in self._kept:
            return
        self._kept[name] = frame
        self._bytes += frame.size
        while self._bytes > self._most_bytes:
            self.drop(next(iter(self._kept)))

    def find(self, name: FrameName) -> KeptFrame | None:
        """Return a frame; None if it is not kept."""
        return self._kept.get(name)

    def drop(self, name: FrameName) -> None:
        """Drop a frame, if it is kept."""
        frame = self._kept.pop(name, None)
        if frame is not None:
            self._bytes -= frame.size

    def drop_before(self, name: FrameName, waiting: Container[FrameName]) -> None:
        """Drop the earlier frames of a stream, but for those that are ``waiting``."""
        stream, sequence = name
        for old in [old for old in self._kept if old[0] == stream and old[1] < sequence]:
            if old not in waiting:
                self.drop(old)
