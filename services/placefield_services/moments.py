"""The replicated cache of a stream's moments.

A restarted featurizer resumes a stream from the descriptors and the moments in the replay caches of
other services; a restarted channel worker needs only the descriptors. Featurizer, fuser and all
channel workers cache both. While one of them is left, nothing is lost.
"""

from collections import Counter
from functools import partial

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.messages import MomentsMessage
from placefield.bus.replay_cache import MOMENTS, ReplayCache, ReplicatedCache, replicated_cache
from placefield.bus.session import Bus


def cache_moments(bus: Bus, keys: Keys, counts: Counter[str]) -> ReplicatedCache:
    """Cache the moments that a run's featurizer publishes, and answer queries for them."""
    moments = replicated_cache(bus, keys.cache(keys.moments), MOMENTS)
    bus.subscribe(keys.moments, partial(_store, moments.cache), counts)
    return moments


def _store(cache: ReplayCache, received: Received) -> None:
    MomentsMessage.decode(received.payload)
    cache.store(received.header, received.payload)
