"""The featurizer: frames in, descriptors out."""

import threading
from collections import Counter

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.messages import FeatureMessage, FrameMessage
from placefield.bus.session import Publisher, open_bus
from placefield.bus.streams import Arrival, StreamFollower
from placefield.config import Config
from placefield.errors import FrameError
from placefield.features.descriptors import DescriptorModel, DescriptorStream
from placefield.features.extract import feature_of_model
from placefield.maps.map import Map, fingerprint
from placefield_services.process import ServiceProcess

SERVICE = "featurizer"

_LIVE_FRAMES = 2  # of a live stream, that may wait: older ones are dropped


def run_featurizer(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set."""
    keys = Keys(config.run)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, keys)
        inbox = Inbox(process.counts, live_capacity=_LIVE_FRAMES)
        bus.subscribe(keys.frame, inbox.offer, process.counts)
        featurizer = Featurizer(placemap.model, bus.publisher(keys.feature), process.counts)
        with process.sole():
            process.serve(inbox, featurizer.handle, stop)


class Featurizer:
    """Makes each frame of a stream into its descriptor.

    Counts ``unreadable`` frames; they go on as frames that were not seen, so that none is missing.
    """

    def __init__(self, model: DescriptorModel, publisher: Publisher, counts: Counter[str]) -> None:
        self._model = model
        self._feature = feature_of_model(model)
        self._fingerprint = fingerprint(model)
        self._publisher = publisher
        self._counts = counts
        self._follower = StreamFollower(counts)
        self._descriptors = DescriptorStream(model)

    def handle(self, received: Received) -> None:
        """Take a frame, publish its descriptor."""
        frame = None if received.header.end else FrameMessage.decode(received.payload)
        arrival = self._follower.follow(received.header)
        if arrival is Arrival.DROPPED:
            return
        if arrival is Arrival.NEW_STREAM:
            self._descriptors = DescriptorStream(self._model)
        feature = None if frame is None else self._describe(frame)
        self._publisher.put(received.header, feature)

    def _describe(self, frame: FrameMessage) -> FeatureMessage:
        try:
            raw = self._feature.describe(frame.image)
        except FrameError:
            self._counts["unreadable"] += 1
            return FeatureMessage(model=self._fingerprint, descriptor=None)
        return FeatureMessage(model=self._fingerprint, descriptor=self._descriptors.push(raw))
