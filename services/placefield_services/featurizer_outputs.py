"""How a featurizer publishes its results, and gets those of other processes."""

from dataclasses import dataclass

from placefield.bus.publishing import Publisher
from placefield.bus.replay_cache import CachedPublisher, Fetch
from placefield_services.raw_features import RawFeatures


@dataclass(frozen=True)
class FeaturizerOutputs:
    """How a featurizer publishes its results for a run, and gets those of other processes.

    Attributes:
        features: publishes descriptors.
        moments: publishes the moments of the stream.
        unobserved: publishes which frames are missing observations.
        fetch_features: fetches the descriptors of its predecessor.
        fetch_moments: fetches the moments of its predecessor.
        raws: the raw features of the describers.
    """

    features: CachedPublisher
    moments: CachedPublisher
    unobserved: Publisher
    fetch_features: Fetch
    fetch_moments: Fetch
    raws: RawFeatures
