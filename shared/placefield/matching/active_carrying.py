"""Where metres travelled lead to on a large map, of which some places are active."""

import numpy as np
from numpy.typing import NDArray

from placefield.matching.carrying import carry, reached_by
from placefield.matching.chains import NO_JUNCTIONS, NO_PASSAGES, ONE_CHAIN, Chains
from placefield.matching.motion import Array
from placefield.matching.odometry import Displacement
from placefield.matching.roads import Roads, RouteCells

Places = NDArray[np.int32]


def reached_in_both_ways(displacement: Displacement, roads: Roads, places: Places) -> Places:
    """Return where a displacement may lead from some places, (n,), on the map or its reverse."""
    back = displacement._replace(metres=-displacement.metres)
    return np.concatenate([reached_by(each, roads, places) for each in (displacement, back)])


def carried_to_active(
    active: Places, kept: tuple[Places, Array], roads: Roads, displacement: Displacement
) -> Array:
    """Carry the beliefs of some places to the active ones.

    Args:
        active: (n,) int32, ascending.
        kept: the places, (m,) int32, ascending, which are active, too; and their beliefs, (2, m)
            float32.
        roads: of the map, with cells.
        displacement: of the vehicle.

    Returns:
        The beliefs that stay at an active place and those that come to it, (2, 2, n) float32.
    """
    first, merged = _merged(active, roads)
    places, belief = kept
    carried = np.zeros((2, 2, len(first)), np.float32)
    carry(_rows(first, places), belief.T.copy(), merged, displacement, 0, carried)
    return np.take(carried, _rows(first, active), axis=2)


def staying(roads: Roads, displacement: Displacement) -> float:
    """Return the chance that a displacement leads out of no cell of the mean width."""
    assert roads.cells is not None
    spacing = roads.cells.spacing
    cell = RouteCells(np.zeros(1), np.array([-spacing, spacing]) / 2, spacing)
    line, here = Roads(ONE_CHAIN, NO_JUNCTIONS, cell), np.zeros(1, np.int32)
    carried = np.zeros((2, 2, 1), np.float32)
    carry(here, np.ones((1, 2), np.float32), line, displacement, 0, carried)
    return float(carried[0, 0, 0])


def _merged(active: Places, roads: Roads) -> tuple[Places, Roads]:
    """Return roads where all places between two active ones of a chain are one place.

    Returns:
        The first place of the map in each of theirs, (n,) int32; and the roads.
    """
    cells, chains = roads.cells, roads.chains
    assert cells is not None
    count = len(cells.middles)
    chain_edges = np.minimum(chains.edges, count).astype(np.int32)
    begins = np.unique(np.concatenate([active, active + np.int32(1), chain_edges]))
    edges = cells.edges[begins]
    merged = RouteCells((edges[1:] + edges[:-1]) / 2, edges, cells.spacing)
    numbers = Chains(_rows(begins, chain_edges), NO_PASSAGES, NO_PASSAGES)
    return begins[:-1], Roads(numbers, roads.junctions, merged)


def _rows(first: Places, places: Places) -> Places:
    return np.searchsorted(first, places).astype(np.int32)
