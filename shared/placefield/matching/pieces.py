"""The pieces of chains in a shard, and the beliefs from where a vehicle may come into each."""

import numpy as np

from placefield.matching.chains import Chains, Passages
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
                self._pass(passages, hypothesis, last, halos)
        before = [halos[0, 0], sides[0, :, REACH - self._before :]]
        after = [sides[1, :, : self._after], halos[-1, 1]]
        halos[0, 0] = np.concatenate(before, axis=1)[:, -REACH:]
        halos[-1, 1] = np.concatenate(after, axis=1)[:, :REACH]
        return np.float32(1 - LOSE) * halos

    def _pass(self, passages: Passages, hypothesis: int, last: Trace, halos: Array) -> None:
        """Add the beliefs of a frame to the halos of the pieces that passages lead to."""
        edges, places = self._chains.edges, last.places
        shifts = passages.shift.astype(np.int64)
        # In the order of places, the halo of a piece, seen from the source, begins here.
        if hypothesis == 0:
            begins = edges[passages.target] + shifts - REACH
        else:
            begins = edges[passages.target + 1] + shifts
        lows = np.maximum(begins, edges[passages.source])
        highs = np.minimum(begins + REACH, edges[passages.source + 1])
        counts = np.searchsorted(places, highs) - np.searchsorted(places, lows)
        for i in np.flatnonzero(counts):
            # Places from other shards may not ascend, if they were forged.
            rows = np.flatnonzero((places >= lows[i]) & (places < highs[i]))
            halo = halos[passages.target[i] - self._first, hypothesis]
            belief = last.belief[rows, hypothesis]
            halo[:, places[rows] - begins[i]] += passages.chance[i] * belief.T
