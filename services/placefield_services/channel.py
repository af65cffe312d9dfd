"""The channel worker: descriptors in, a candidate per channel out."""

import threading
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys, channel_identity
from placefield.bus.messages import CandidateMessage, FeatureMessage, Header
from placefield.bus.session import Publisher, open_bus
from placefield.bus.streams import Arrival, StreamFollower
from placefield.config import Config, MatchingConfig
from placefield.errors import ConfigError, MessageError
from placefield.maps.map import Map, fingerprint
from placefield.matching.channel_matcher import ChannelMatcher, matcher_of
from placefield_services.process import ServiceProcess

SERVICE = "channel"

_LONGEST = 1.001  # descriptor; they have length 1, or 0 where there is nothing to see
_LIVE_FEATURES = 2  # of a live stream, that may wait: older ones are dropped


def run_channels(
    placemap: Map, channels: Sequence[int], config: Config, stop: threading.Event
) -> None:
    """Serve these channels of a map until ``stop`` is set.

    Raises:
        ConfigError: the map has no such channel.
    """
    for channel in channels:
        if channel >= len(placemap.channels):
            raise ConfigError(
                f"--channel {channel}: the map has channels 0 to {len(placemap.channels) - 1}"
            )
    keys = Keys(config.run)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, keys)
        inbox = Inbox(process.counts, live_capacity=_LIVE_FEATURES)
        bus.subscribe(keys.feature, inbox.offer, process.counts)
        publishers = {number: bus.publisher(keys.candidate(number)) for number in channels}
        worker = ChannelWorker(placemap, publishers, config.matching, process.counts)
        for channel in channels:
            process.declare_ready(channel_identity(channel, process.identity))
        process.serve(inbox, worker.handle, stop)


class ChannelWorker:
    """Matches a stream of descriptors in one or more channels.

    A frame that did not come is matched as one that was not seen: the vehicle has moved on.
    """

    def __init__(
        self,
        placemap: Map,
        publishers: Mapping[int, Publisher],
        matching: MatchingConfig,
        counts: Counter[str],
    ) -> None:
        self._map = placemap
        self._publishers = publishers
        self._matching = matching
        self._model = fingerprint(placemap.model)
        self._follower = StreamFollower(counts)
        self._matchers: dict[int, ChannelMatcher] = {}

    def handle(self, received: Received) -> None:
        """Take a descriptor, publish a candidate of each channel."""
        header = received.header
        feature = None if header.end else self._decode(received.payload)
        arrival = self._follower.follow(header)
        if arrival is Arrival.DROPPED:
            return
        if arrival is Arrival.NEW_STREAM:
            self._matchers = {
                number: matcher_of(
                    self._map.channels[number],
                    self._matching.rule,
                    reverse=self._matching.reverse,
                )
                for number in self._publishers
            }
        for number, matcher in self._matchers.items():
            if feature is None:
                self._publishers[number].put(header)
            else:
                self._match(number, matcher, header, feature)

    def _decode(self, payload: bytes) -> FeatureMessage:
        feature = FeatureMessage.decode(payload)
        if feature.model != self._model:
            raise MessageError(
                f"descriptor of model {feature.model}; this channel's map has {self._model}: "
                "give the featurizer the same map"
            )
        dimensions = len(self._map.model.components)
        if feature.descriptor is not None and len(feature.descriptor) != dimensions:
            raise MessageError(f"descriptor of {len(feature.descriptor)}, not {dimensions} values")
        if feature.descriptor is not None:
            length = float(np.linalg.norm(feature.descriptor.astype(np.float64)))
            if length > _LONGEST:  # what overflows once would spoil all sums of the stream
                raise MessageError(f"descriptor of length {length:.3g}, not 1")
        return feature

    def _match(
        self, number: int, matcher: ChannelMatcher, header: Header, feature: FeatureMessage
    ) -> None:
        for _ in range(min(self._follower.gap, matcher.memory)):
            matcher.push(None)
        candidate = matcher.push(feature.descriptor)
        message = CandidateMessage(
            rule=self._matching.rule,
            channel=number,
            place=candidate.place,
            score=candidate.score,
            evidence=candidate.evidence,
        )
        self._publishers[number].put(header, message)
