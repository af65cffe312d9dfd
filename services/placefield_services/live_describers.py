"""Tracks by liveliness tokens which describers a run has, and which frame each of them describes.

The describers and the featurizer describe frames in turn. Every process computes the turns from the
tokens that it sees. If two processes see different tokens for a moment, a frame is described twice,
or the featurizer describes it although it was not its turn.
"""

from placefield.bus.keys import Keys, service_and_identity
from placefield.bus.session import MOST_TOKENS, Bus

SERVICE = "describer"


class LiveDescribers:
    """The living describers of a run, and whose turn each frame is."""

    def __init__(self) -> None:
        self.alive: tuple[str, ...] = ()
        """The identities of the living describers, in order."""

    def change(self, key: str, is_alive: bool) -> None:
        """Record that a token has appeared or disappeared; at most ``MOST_TOKENS`` are kept."""
        _, identity = service_and_identity(key)
        others = set(self.alive) - {identity}
        if is_alive and len(others) < MOST_TOKENS:
            others.add(identity)
        self.alive = tuple(sorted(others))  # one assignment: other threads read it

    def whose(self, sequence: int) -> str | None:
        """Return the describer of the frame with this number; None: the featurizer itself."""
        alive = self.alive
        turn = sequence % (len(alive) + 1)
        return alive[turn] if turn < len(alive) else None


def live_describers(bus: Bus, keys: Keys) -> LiveDescribers:
    """Track the describers of a run."""
    describers = LiveDescribers()
    bus.watch_alive(keys.all_alive(SERVICE), describers.change)
    return describers
