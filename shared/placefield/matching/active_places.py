"""The places of a large map that a filter has beliefs of, and what surrounds them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from placefield.matching.chains import Chains, Passages, crossed_back_to, crossed_to
from placefield.matching.motion import REACH, Array
from placefield.search.inverted import distinct

Places = NDArray[np.int32]


class ActivePlaces(NamedTuple):
    """Some places of a map, and the pieces of its chains that they are in.

    Attributes:
        places: (n,) int32, ascending.
        pieces: (P + 1,) int32, where the places of each chain begin, then n.
        chains: (P,) int32, the chain of each piece.
    """

    places: Places
    pieces: Places
    chains: Places


def active_places(kept: Places, proposed: Places, chains: Chains, count: int) -> ActivePlaces:
    """Return the proposed places, and those that a step from the kept ones may lead to.

    On either side of a kept place, ``REACH`` places are active, as far as its chain goes. So of
    two places that follow each other among the active ones, a step from one leads to the other only
    if it does so on the map, or if both have the belief of the places that are not kept.

    Args:
        kept: (m,) int32, ascending, the places that have a belief of their own.
        proposed: (n,) int32.
        chains: of the map.
        count: K, places of the map.
    """
    of = chains.of(kept)
    low, high = chains.edges[of], np.minimum(chains.edges[of + 1], np.int32(count)) - np.int32(1)
    around = np.add.outer(kept, np.arange(-REACH, REACH + 1, dtype=np.int32))
    around = np.clip(around, low[:, None], high[:, None])
    crossed = crossed_to(chains, kept), crossed_back_to(chains, kept)
    places = distinct(np.concatenate([around.ravel(), *crossed, proposed]))
    of = chains.of(places)
    begins = np.flatnonzero(np.append(True, of[1:] != of[:-1]))
    pieces = np.append(begins, len(places)).astype(np.int32)
    return ActivePlaces(places, pieces, of[begins])


class Surroundings(NamedTuple):
    """The beliefs in all places of a map, of which most have the same.

    Attributes:
        active: the places that have a belief of their own.
        belief: (2, S, n) float32, of each, on the map and on its reverse.
        elsewhere: (2, S) float32, of each other place.
    """

    active: ActivePlaces
    belief: Array
    elsewhere: Array

    def halos(self, chains: Chains) -> Array:
        """Return the beliefs in the places around each piece, (P, 2, S, REACH) float32.

        On the map those before the piece, which may be in several chains, and on its reverse those
        after it.
        """
        places, pieces, numbers = self.active
        halos = np.empty((len(numbers), *self.elsewhere.shape, REACH), np.float32)
        halos[:] = self.elsewhere[:, :, None]
        begins, ends = chains.edges[numbers], chains.edges[numbers + 1]
        before = np.minimum(places[pieces[:-1]] - begins, REACH)
        after = np.minimum(ends - 1 - places[pieces[1:] - 1], REACH)
        for piece in np.flatnonzero((before < REACH) | (after < REACH)):
            beyond = self._beyond(0, chains.ahead, chains.edges, numbers[piece])
            halos[piece, 0, :, : REACH - before[piece]] = beyond[:, before[piece] :]
            beyond = self._beyond(1, chains.behind, chains.edges, numbers[piece])
            halos[piece, 1, :, after[piece] :] = beyond[:, : REACH - after[piece]]
        return halos

    def _beyond(self, hypothesis: int, passages: Passages, edges: Places, chain: int) -> Array:
        """Return the beliefs in the places beyond the end of a chain, (S, REACH)."""
        beyond = np.zeros((self.elsewhere.shape[1], REACH), np.float32)
        first = int(edges[chain]) - REACH if hypothesis == 0 else int(edges[chain + 1])
        for i in np.flatnonzero(passages.target == chain):
            seen = np.arange(first, first + REACH) + int(passages.shift[i])
            source = passages.source[i]
            inside = np.flatnonzero((seen >= edges[source]) & (seen < edges[source + 1]))
            there = self._at(seen[inside], hypothesis)
            beyond[:, inside] += passages.chance[i] * there
        return beyond

    def _at(self, places: NDArray[np.int64], hypothesis: int) -> Array:
        """Return the beliefs in some places, (S, n) float32."""
        own = self.active.places
        rows = np.minimum(np.searchsorted(own, places), len(own) - 1)
        there = self.belief[hypothesis][:, rows]
        return np.asarray(np.where(own[rows] == places, there, self.elsewhere[hypothesis][:, None]))
