"""Which verifiers of a run are alive, and which of them a match belongs to."""

import threading
from collections.abc import Collection, Set

from placefield.bus.keys import service_and_identity
from placefield.bus.session import MOST_TOKENS

_IN_A_ROW = 8  # frames that fall to one verifier, as each hand-over to another may take a while


class LiveVerifiers:
    """The identities of a run's live verifiers, this one's among them."""

    def __init__(self, own: str, elders: Collection[str]) -> None:
        """Begin with this verifier alone; ``elders`` are the identities that were there before."""
        self._own, self._elders = own, frozenset(elders) - {own}
        self._lock = threading.Lock()
        self.alive = frozenset({own})
        """The verifiers that are alive now."""

    def change(self, key: str, is_alive: bool) -> None:
        """Record that a verifier's token has appeared or disappeared; see ``Bus.watch_alive``."""
        _, identity = service_and_identity(key)
        with self._lock:
            if not is_alive:
                self.alive = self.alive - {identity} | {self._own}
            elif len(self.alive) < MOST_TOKENS:
                self.alive |= {identity}

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
        sharing = sorted(having & self.alive) or [self._own]
        return sharing[sequence // _IN_A_ROW % len(sharing)] == self._own
