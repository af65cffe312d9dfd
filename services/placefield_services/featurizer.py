"""The featurizer: frames in, descriptors out."""

import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from placefield.bus.inbox import Inbox, Received
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

_LIVE_FRAMES = 2  # of a run, that may wait: older ones are dropped


def run_featurizer(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set."""
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        inbox = Inbox(process.counts, live_capacity=_LIVE_FRAMES)
        publishers = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.frame, inbox.offer, process.counts[run])
            publishers[run] = bus.publisher(keys.feature)
        featurizer = Featurizer(placemap.model, publishers, process.counts)
        featurizer.rehearse()
        with process.sole():
            # Frames share no work; one that waits may still make room for a newer one.
            process.serve(inbox, featurizer.handle, stop, at_once=1)


@dataclass
class _Run:
    publisher: Publisher
    counts: Counter[str]
    follower: StreamFollower
    descriptors: DescriptorStream


class Featurizer:
    """Makes each frame of a stream into its descriptor, in one stream per run at a time.

    Counts ``unreadable`` frames; they go on as frames that were not seen, so that none is missing.
    """

    def __init__(
        self,
        model: DescriptorModel,
        publishers: Mapping[str, Publisher],
        counts: Mapping[str, Counter[str]],
    ) -> None:
        """Publish and count by run."""
        self._model = model
        self._feature = feature_of_model(model)
        self._fingerprint = fingerprint(model)
        self._runs = {
            run: _Run(publisher, counts[run], StreamFollower(counts[run]), DescriptorStream(model))
            for run, publisher in publishers.items()
        }

    def rehearse(self) -> None:
        """Describe a frame of no stream, so that what is made at its first use is made."""
        frame = np.zeros((48, 64, 3), np.uint8)
        self._feature.describe(frame)
        frame.flags.writeable = False  # as frames of pixels come from the bus
        self._feature.describe(frame)

    def handle(self, received: Received) -> None:
        """Take a frame, publish its descriptor."""
        header, run = received.header, self._runs[received.run]
        frame = None if header.end else FrameMessage.decode(received.payload)
        arrival = run.follower.follow(header)
        if arrival is Arrival.DROPPED:
            return
        if arrival is Arrival.NEW_STREAM:
            run.descriptors = DescriptorStream(self._model)
        feature = None if frame is None else self._describe(run, frame)
        run.publisher.put(header, feature)

    def _describe(self, run: _Run, frame: FrameMessage) -> FeatureMessage:
        try:
            raw = self._feature.describe(frame.image)
        except FrameError:
            run.counts["unreadable"] += 1
            return FeatureMessage(model=self._fingerprint, descriptor=None)
        return FeatureMessage(model=self._fingerprint, descriptor=run.descriptors.push(raw))
