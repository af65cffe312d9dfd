"""Which verifiers of a run are alive, and which of them a match belongs to."""

from collections.abc import Collection, Set

from placefield_services.live_tokens import LiveTokens

_IN_A_ROW = 8  # frames that fall to one verifier, as each hand-over to another may take a while


class LiveVerifiers(LiveTokens):
    """The identities of a run's live verifiers, this one's among them."""

    def __init__(self, own: str, elders: Collection[str]) -> None:
        """Begin with this verifier alone; ``elders`` are the identities that were there before."""
        super().__init__(own)
        self._identity, self._elders = own, frozenset(elders) - {own}

    @property
    def is_oldest(self) -> bool:
        """Whether none is alive that was there before this one, and may know more."""
        return not self._elders & self.alive

    def is_own(self, sequence: int, having: Set[str]) -> bool:
        """Return whether a frame falls to this verifier, and not to another that has it.

        Args:
            sequence: number of the frame.
            having: the verifiers that were alive when the frame came.
        """
        sharing = sorted(having & self.alive) or [self._identity]
        return sharing[sequence // _IN_A_ROW % len(sharing)] == self._identity
