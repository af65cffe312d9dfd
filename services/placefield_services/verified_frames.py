"""Which frames of a run are verified, and the posteriors after them."""

from typing import NamedTuple

from placefield.verification.inlier_model import Array
from placefield_services.kept_frames import FrameName

_MOST = 4096  # frames that are remembered, and how far back one counts


class Before(NamedTuple):
    """What is known of the frames before a frame.

    Attributes:
        posterior: after the newest of them with a known one; None if there is none.
        frames: how many frames earlier that one is.
    """

    posterior: Array | None
    frames: int = 1


class VerifiedFrames:
    """The frames that were verified last, by any verifier."""

    def __init__(self) -> None:
        self._posteriors: dict[FrameName, Array | None] = {}

    def add(self, name: FrameName, posterior: Array | None) -> None:
        """Remember a frame, and the posterior after it, if its message had one."""
        self._posteriors[name] = posterior
        if len(self._posteriors) > _MOST:
            del self._posteriors[next(iter(self._posteriors))]

    def __contains__(self, name: FrameName) -> bool:
        """Return whether a frame is remembered."""
        return name in self._posteriors

    def before(self, name: FrameName) -> Before:
        """Return what is known of the frames before a frame of a stream."""
        stream, sequence = name
        for frames in range(1, min(sequence, _MOST) + 1):
            posterior = self._posteriors.get((stream, sequence - frames))
            if posterior is not None:
                return Before(posterior, frames)
        return Before(None)
