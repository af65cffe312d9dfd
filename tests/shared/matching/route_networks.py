"""Made-up networks of routes, for tests of what follows their links."""

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st

from placefield.maps.route_graph import RouteGraph
from placefield.maps.topology import Topology

Link = tuple[int, int]


def network(
    count: int,
    first: Sequence[int] = (0,),
    links: Sequence[Link] = (),
    travelled: Sequence[float] = (),
) -> Topology:
    """Places on routes that begin with these places, and links between them."""
    graph = RouteGraph(
        tuple(map(str, first)),
        np.array(first, np.int32),
        np.array(sorted(links), np.int32).reshape(-1, 2),
    )
    return Topology(graph, np.array(travelled, np.float64), np.arange(count, dtype=np.int32))


@st.composite
def networks(draw: st.DrawFn, count: int) -> Topology:
    """Routes of any length, with links from anywhere to anywhere: forks, joins and circuits."""
    place = st.integers(0, count - 1)
    first = sorted({0, *draw(st.lists(place, max_size=4))})
    drawn = draw(st.lists(st.tuples(place, place), max_size=5))
    return network(count, first, sorted({(a, b) for a, b in drawn if b != a + 1 or b in first}))
