"""Tracks which processes of a service are alive in a run."""

from placefield.bus.keys import service_and_identity
from placefield.bus.session import MOST_TOKENS


class LiveTokens:
    """The identities in the liveliness tokens of a service, at most ``MOST_TOKENS``.

    One thread may call ``change`` while others read.
    """

    def __init__(self, *own: str) -> None:
        """Begin with the identities of this process, which stay."""
        self._own = frozenset(own)
        self.alive = self._own
        """The identities that are alive now."""

    def change(self, key: str, is_alive: bool) -> None:
        """Record that a token has appeared or disappeared; see ``Bus.watch_alive``."""
        _, identity = service_and_identity(key)
        if not is_alive:
            self.alive = self.alive - {identity} | self._own
        elif len(self.alive) < MOST_TOKENS:
            self.alive |= {identity}
