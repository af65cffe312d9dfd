"""The describer: it receives frames and publishes the raw features of its share of them.

A run may have any number of describers, or none. They have no state: the featurizer standardises
the raw features in order, and describes each frame itself whose raw feature does not come.
"""

import threading
from collections import Counter
from collections.abc import Mapping
from functools import partial

from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Inbox, Received
from placefield.bus.messages import FrameMessage, RawFeatureMessage
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.bus.session import open_bus
from placefield.config import Config
from placefield.errors import ConfigError, FrameError
from placefield.features.descriptor_stage import DescriptorStage, FrameStage, warm_up
from placefield.features.extract import Feature
from placefield.maps.map import Map, fingerprint
from placefield_services.frame_of_message import frame_of
from placefield_services.live_describers import SERVICE, LiveDescribers, live_describers
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.served import Served

_LIVE_FRAMES = 1  # live frames of a run that may wait for this describer; older ones are dropped


def run_describer(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set.

    Raises:
        ConfigError: the frames of the map are given descriptors.
    """
    stage = DescriptorStage(placemap.model, config.inference)
    serve_describer(stage, fingerprint(placemap.model), placemap, config, stop)


def serve_describer(
    stage: FrameStage, model: str, served: Served, config: Config, stop: threading.Event
) -> None:
    """Serve with a stage, whose fingerprint is ``model``, until ``stop`` is set.

    Raises:
        ConfigError: the frames are given descriptors.
    """
    if not stage.feature.describes_images:
        raise ConfigError("descriptors need no describer; leave it out")
    warm_up(stage)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        serve_metrics(config.monitoring, process.report)
        inbox = Inbox(process.counts, live_capacity=_LIVE_FRAMES)
        outputs = {}
        for run, keys in process.keys.items():
            take = partial(_take_own, live_describers(bus, keys), process.identity, inbox)
            bus.subscribe(keys.frame, take, process.counts[run])
            raws = bus.publisher(keys.raw(process.identity))
            outputs[run] = CachedPublisher(raws, ReplayCache(2 * WINDOW))
            process.answers[run] = outputs[run].cache
        describer = FrameDescriber(stage.feature, model, outputs, process.counts)

        def handle(received: Received) -> None:
            served.check_unchanged()  # the network is memory-mapped from the map's files
            describer.handle(received)

        process.declare_ready(process.identity)
        process.serve(inbox, handle, stop, at_once=1)


def _take_own(describers: LiveDescribers, identity: str, inbox: Inbox, received: Received) -> None:
    """Put a frame in the inbox if it is this describer's turn."""
    header = received.header
    if not header.end and describers.whose(header.sequence) == identity:
        inbox.offer(received)


class FrameDescriber:
    """Publishes the raw feature of each frame that it is given.

    Counts frames that are ``unreadable``, and as ``repeated`` those whose raw feature is published
    again.
    """

    def __init__(
        self,
        feature: Feature,
        model: str,
        outputs: Mapping[str, CachedPublisher],
        counts: Mapping[str, Counter[str]],
    ) -> None:
        """Describe by the feature of the model with this fingerprint.

        Publish to the output of each run, and count in the counts of each run.
        """
        self._feature = feature
        self._model = model
        self._outputs = outputs
        self._counts = counts

    def handle(self, received: Received) -> None:
        """Publish the raw feature of a frame; a given descriptor is left to the featurizer.

        Raises:
            MessageError: it is no frame.
        """
        header, output = received.header, self._outputs[received.run]
        if output.put_again(header):
            self._counts[received.run]["repeated"] += 1
            return
        message = FrameMessage.decode(received.payload)
        if message.image is None:
            return
        raw = None
        try:
            raw = self._feature.of_frame(frame_of(header, message))
        except FrameError:  # the featurizer will find the same, and say so
            self._counts[received.run]["unreadable"] += 1
        finally:  # after a defect, too: the featurizer waits
            output.put(header, RawFeatureMessage(model=self._model, raw=raw))
