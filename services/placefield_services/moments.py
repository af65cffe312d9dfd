"""What services remember for each other of a stream, so that none of them is its only home.

The featurizer goes on with a stream by the descriptors and the moments that others remember; a
channel worker by the descriptors. Featurizer, fuser and all channel workers remember them: while
one of these is left, nothing is forgotten.
"""

from collections import Counter
from functools import partial

from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.messages import MomentsMessage
from placefield.bus.replay_cache import MOMENTS, ReplayCache, ReplicatedCache, replicated_cache
from placefield.bus.session import Bus


def cache_moments(bus: Bus, keys: Keys, counts: Counter[str]) -> ReplicatedCache:
    """Remember the moments that a run's featurizer publishes, and share them."""
    moments = replicated_cache(bus, keys.cache(keys.moments), MOMENTS)
    bus.subscribe(keys.moments, partial(_remember, moments.cache), counts)
    return moments


def _remember(cache: ReplayCache, received: Received) -> None:
    MomentsMessage.decode(received.payload)
    cache.store(received.header, received.payload)
