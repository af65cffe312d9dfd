"""How a channel worker publishes its results for a run, and fetches what it missed."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from placefield.bus.credits import WINDOW
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.replay_cache import (
    CachedPublisher,
    Fetch,
    ReplayCache,
    fetch_all,
    replicated_cache,
    serve_caches,
)
from placefield.bus.session import Bus
from placefield_services.background_query import BackgroundQuery


@dataclass(frozen=True)
class ChannelOutputs:
    """How a worker publishes its results for a run, and fetches the messages that it missed.

    Attributes:
        candidates: publishes the candidates.
        fetch: fetches descriptors from other replay caches, or raises ``NotYet``.
        features: keeps the descriptors, for the other services and for a new version of the map.
        halos: publishes the partial results of the worker's shards.
        fetch_halos: fetches the partial results of all shards for a range of frames, or raises
            ``NotYet``.
        counts: of the run.
    """

    candidates: CachedPublisher
    fetch: Fetch
    features: ReplayCache
    halos: CachedPublisher
    fetch_halos: Callable[[str, int, int], Iterable[tuple[Header, bytes]]]
    counts: Counter[str]

    def another(self) -> "ChannelOutputs":
        """Return outputs on the same keys for another version of the map."""
        return replace(self, candidates=self.candidates.another(), halos=self.halos.another())

    def retire(self) -> None:
        """Keep no more results of this version for other services."""
        self.candidates.retire()
        self.halos.retire()


def channel_outputs(
    bus: Bus, keys: Keys, identity: str, lag: int, counts: Counter[str]
) -> ChannelOutputs:
    """Return the outputs of a worker for a run.

    Args:
        bus: where it publishes.
        keys: of the run.
        identity: of the worker, which no other has.
        lag: of the smoothing, frames.
        counts: of the run.
    """
    candidates = candidates_publisher(bus, keys, identity, lag)
    halos = CachedPublisher(bus.publisher(keys.halo(identity)), ReplayCache())
    cache = keys.cache(keys.all_halos)
    serve_caches(bus, cache, halos.caches)
    features = replicated_cache(bus, keys.cache(keys.feature))
    return ChannelOutputs(
        candidates=candidates,
        fetch=BackgroundQuery(features.fetch),
        features=features.cache,
        halos=halos,
        fetch_halos=BackgroundQuery(lambda *asked: list(fetch_all(bus, cache, *asked))),
        counts=counts,
    )


def candidates_publisher(bus: Bus, keys: Keys, identity: str, lag: int) -> CachedPublisher:
    """Return what publishes a worker's candidates, and keeps them for a fuser that restarts.

    It keeps those of frames under way, and of frames that the fuser may have to smooth. See
    ``channel_outputs`` for the arguments.
    """
    cache = ReplayCache(2 * WINDOW + lag)
    candidates = CachedPublisher(bus.gathering_publisher(keys.candidates(identity)), cache)
    serve_caches(bus, keys.cache(keys.all_candidates), candidates.caches)
    return candidates
