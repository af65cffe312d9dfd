"""Tracks which describers a run has, and which part of which frame each of them describes.

The feature of a map has one part or more. The describers and the featurizer describe the parts of
the frames in turn, except parts that describers are bound to: those take turns at them. Every
process computes the turns from the tokens that it sees. If two processes see different tokens for a
moment, a part is described twice, or the featurizer describes it although it was not its turn.
"""

from collections import defaultdict
from collections.abc import Mapping
from itertools import chain

from placefield.bus.keys import Keys
from placefield.bus.session import Bus
from placefield_services.live_tokens import LiveTokens

SERVICE = "describer"


def identity_of(worker: str, part: int | None = None) -> str:
    """Return the name of a describer's token, as ``ab12``, or ``1-ab12`` if it is bound to part 1.

    ``LiveDescribers`` reads it.
    """
    return worker if part is None else f"{part}-{worker}"


class LiveDescribers(LiveTokens):
    """The living describers of a run, and whose turn each part of a frame is."""

    def __init__(self) -> None:
        super().__init__()
        self.workers: frozenset[str] = frozenset()
        """The living describers, by the names on their keys."""
        self._of_part: Mapping[str, list[str]] = {}
        """The describers that are bound to each part, and those bound to none, ``""``; in order."""

    def change(self, key: str, is_alive: bool) -> None:
        """Record that a token has appeared or disappeared; see ``Bus.watch_alive``."""
        super().change(key, is_alive)
        of_part = defaultdict(list)
        for identity in sorted(self.alive):
            part, _, worker = identity.rpartition("-")
            of_part[part].append(worker)
        self._of_part = dict(of_part)  # one assignment: other threads read it
        self.workers = frozenset(chain.from_iterable(of_part.values()))

    def whose(self, sequence: int, part: int) -> str | None:
        """Return the describer of a part of the frame with this number; None: the featurizer."""
        of_part = self._of_part
        takers = of_part.get(str(part)) or (*of_part.get("", ()), None)
        # Parts take different times: over the frames each taker has an equal share of each part.
        return takers[(sequence + part) % len(takers)]


def live_describers(bus: Bus, keys: Keys) -> LiveDescribers:
    """Track the describers of a run."""
    describers = LiveDescribers()
    bus.watch_alive(keys.all_alive(SERVICE), describers.change)
    return describers
