"""The pieces of chains in a shard, and the beliefs from where a vehicle may come into each."""

import numpy as np

from placefield.kernels import kernel
from placefield.matching.chains import Chains, Passages, Places
from placefield.matching.motion import LOSE, REACH, SPEEDS, Array
from placefield.matching.trace import Trace


class Pieces:
    """The pieces of the chains of a map in a shard of it."""

    def __init__(self, chains: Chains, own: slice, count: int) -> None:
        """Cut the shard with these places of a map of so many."""
        inside = chains.edges[(chains.edges > own.start) & (chains.edges < own.stop)]
        self.edges = np.concatenate([[own.start], inside, [own.stop]]).astype(np.int32) - own.start
        """(P + 1,) int32, the first place of each piece in the shard, then the shard's end."""
        self._first = int(chains.of(np.array(own.start, np.int32)))  # chain of the first piece
        last = self._first + len(inside)
        # Places of the first piece's chain before the shard, and of the last one's after it.
        self._before = min(own.start - int(chains.edges[self._first]), REACH)
        self._after = min(int(chains.edges[last + 1]) - own.stop, count - own.stop, REACH)
        self._chains = chains
        self._into = [self._into_shard(each, last) for each in (chains.ahead, chains.behind)]
        passages = sum(len(each.source) for each in self._into)
        self._is_closed = self._before == self._after == passages == 0
        self._nothing = np.zeros((len(self.edges) - 1, 2, len(SPEEDS), REACH), np.float32)

    def _into_shard(self, passages: Passages, last: int) -> Passages:
        """Return the passages that lead to the shard's pieces."""
        leads = (passages.target >= self._first) & (passages.target <= last)
        source, target, shift, chance = passages
        return Passages(source[leads], target[leads], shift[leads], chance[leads])

    def halos(self, sides: Array, last: Trace | None) -> Array:
        """Return the beliefs that may move into each piece, (P, 2, S, REACH) float32.

        They are normalised, and times the chance to stay on the map: on the map those in the places
        before the piece, which may be in several chains, and on its reverse those in the places
        after it.

        Args:
            sides: (2, S, REACH) float32, the beliefs in the places next to the shard, by number.
            last: trace of the frame before; None if there is none.
        """
        if self._is_closed:
            return self._nothing
        halos = self._nothing.copy()
        for hypothesis, passages in enumerate(self._into):
            if last is not None and len(passages.source):
                where = self._chains.edges, self._first, hypothesis
                _pass_on(passages, *where, last.places, last.belief, halos)
        before = [halos[0, 0], sides[0, :, REACH - self._before :]]
        after = [sides[1, :, : self._after], halos[-1, 1]]
        halos[0, 0] = np.concatenate(before, axis=1)[:, -REACH:]
        halos[-1, 1] = np.concatenate(after, axis=1)[:, :REACH]
        return np.float32(1 - LOSE) * halos


@kernel
def _pass_on(
    passages: Passages,
    edges: Places,
    first: int,
    hypothesis: int,
    places: Places,
    belief: Array,
    halos: Array,
) -> None:
    """Add the beliefs of a frame to the halos of the pieces that passages lead to.

    Args:
        passages: that lead to the pieces.
        edges: of the chains.
        first: chain of the first piece.
        hypothesis: 0 on the map, 1 on its reverse.
        places: (n,) int32, of the frame; they may be in any order, if they were forged.
        belief: (n, 2, S) float32, in these places.
        halos: (P, 2, S, REACH) float32, changed in place.
    """
    reach = halos.shape[3]
    for i in range(len(passages.source)):
        source, target = passages.source[i], passages.target[i]
        # In the order of places, the halo of a piece, seen from the source, begins here.
        begin = int(passages.shift[i])
        begin += edges[target + 1] if hypothesis else edges[target] - reach
        low, high = max(begin, edges[source]), min(begin + reach, edges[source + 1])
        for row in range(len(places)):
            if low <= places[row] < high:
                column = places[row] - begin
                for speed in range(halos.shape[2]):
                    moved = passages.chance[i] * belief[row, hypothesis, speed]
                    halos[target - first, hypothesis, speed, column] += moved
