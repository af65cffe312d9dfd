"""A new version of the map in a run of the fuser, until it takes the run over."""

from collections.abc import Callable

from placefield.bus.credits import WINDOW
from placefield_services.fuser_stream import FuserStream
from placefield_services.fusion_parts import FusionParts


class NextVersion:
    """Joins the candidates of a new version, and says when it can take the run over.

    The workers answer each frame under both versions. The new version is complete from the first
    frame that all living channels have answered. It takes over when the version before it has
    smoothed all earlier frames, and so has all candidates of each frame that it answers or smooths.
    """

    def __init__(
        self, parts: FusionParts, current: FuserStream, is_there: Callable[[], bool]
    ) -> None:
        """Begin beside the stream that is on.

        Args:
            parts: of the new version.
            current: the stream under the version before.
            is_there: whether the version is still at the path of the map; if not, the workers may
                have dropped it for a newer one.
        """
        self.parts = parts
        self._is_there = is_there
        self._was_complete = False
        self.begin(max(0, current.next - 2 * WINDOW), live=current.live)

    @property
    def digest(self) -> str:
        """Digest of the version."""
        return self.parts.served.digest

    def begin(self, first: int, *, live: bool) -> None:
        """Begin a stream with the frame of this number."""
        self.stream = FuserStream(self.parts, first, live=live)
        self._complete_from: int | None = None

    def can_begin(self) -> bool:
        """Whether it can take the run over between two streams."""
        return self._was_complete and self._is_there()

    def can_continue(self, current: FuserStream) -> bool:
        """Whether it can take over the stream that is on under the version before."""
        self.stream.forget_before(current.next - 2 * WINDOW)
        if self._complete_from is None:
            self._complete_from = self.stream.first_complete()
            self._was_complete |= self._complete_from is not None
        if self._complete_from is None or current.is_ending or not self._is_there():
            return False
        return self._complete_from <= current.oldest_unsmoothed or self._is_ahead_of(current)

    def _is_ahead_of(self, current: FuserStream) -> bool:
        """Whether only this version has all channels of the oldest unanswered frame.

        A worker that was started again answers by the new version alone.
        """
        return self.stream.is_complete(current.next) and not current.is_complete(current.next)
