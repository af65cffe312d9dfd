"""The describer: it receives frames and publishes the raw features of its share of them.

Of a feature with several parts, as GIST and a network, it publishes each part of its share by
itself. A run may have any number of describers, or none. They have no state: the featurizer joins
the parts and standardises the raw features in order, and describes itself what does not come.
"""

import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from placefield.bus.connecting import open_bus
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Inbox, Received
from placefield.bus.messages import FrameMessage, RawFeatureMessage
from placefield.bus.publishing import Publisher
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.config import Config
from placefield.errors import ConfigError, FrameError
from placefield.features.descriptor_stage import DescriptorStage, FrameStage, warm_up
from placefield.features.extract import Array, Feature
from placefield.features.joined_model import model_of_part
from placefield.maps.map import Map, fingerprint
from placefield_services.frame_of_message import frame_of
from placefield_services.live_describers import (
    SERVICE,
    LiveDescribers,
    identity_of,
    live_describers,
)
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.served import Served

_LIVE_FRAMES = 1  # live frames of a run that may wait for this describer; older ones are dropped


def run_describer(
    placemap: Map, config: Config, stop: threading.Event, *, part: int | None = None
) -> None:
    """Serve until ``stop`` is set.

    Args:
        placemap: a map whose frames are images.
        config: of the run.
        stop: ends the service.
        part: the only part of the feature that is described; None: any part.

    Raises:
        ConfigError: the frames of the map are given descriptors.
    """
    whole = placemap.model
    model = whole if part is None else model_of_part(whole, part)
    stage = DescriptorStage(model, config.inference)
    feature = DescribedFeature(stage, fingerprint(whole), part)
    serve_describer(feature, placemap, config, stop)


@dataclass(frozen=True)
class DescribedFeature:
    """What a describer computes.

    Attributes:
        stage: of the feature, or of one part of it.
        model: fingerprint of the whole feature's model.
        part: number of the only part; None: all parts are computed.
    """

    stage: FrameStage
    model: str
    part: int | None = None

    @property
    def parts(self) -> Sequence[int]:
        """The numbers of the parts."""
        all_parts = range(len(self.stage.feature.describing))
        return all_parts if self.part is None else (self.part,)


def serve_describer(
    described: DescribedFeature, served: Served, config: Config, stop: threading.Event
) -> None:
    """Serve until ``stop`` is set.

    Raises:
        ConfigError: the frames are given descriptors.
    """
    stage, parts = described.stage, described.parts
    if not stage.feature.describes_images:
        raise ConfigError("descriptors need no describer; leave it out")
    warm_up(stage)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        serve_metrics(config.monitoring, process.report)
        inbox = Inbox(process.counts, live_capacity=_LIVE_FRAMES)
        outputs = {}
        for run, keys in process.keys.items():
            own = OwnParts(live_describers(bus, keys), process.identity, parts)
            bus.subscribe(keys.frame, partial(own.offer, inbox), process.counts[run])
            outputs[run] = _outputs(bus.publisher(keys.raw(process.identity)), parts)
            process.answers[run] = outputs[run][parts[0]].cache
        describer = FrameDescriber(stage.feature, described.model, outputs, process.counts)

        def handle(received: Received) -> None:
            served.check_unchanged()  # the network is memory-mapped from the map's files
            assert isinstance(received, ReceivedParts)
            describer.handle(received)

        process.declare_ready(identity_of(process.identity, described.part))
        process.serve(inbox, handle, stop, at_once=1)


def _outputs(publisher: Publisher, parts: Sequence[int]) -> dict[int, CachedPublisher]:
    """Return an output for each part, all on one key: a cache has one message of a frame."""
    return {each: CachedPublisher(publisher, ReplayCache(2 * WINDOW)) for each in parts}


@dataclass(frozen=True)
class ReceivedParts(Received):
    """A received frame, and the parts of it that this describer describes."""

    parts: Sequence[int]


@dataclass(frozen=True)
class OwnParts:
    """Which parts of which frames of a run are a describer's turn.

    Attributes:
        describers: of the run.
        identity: of the describer.
        parts: that it can describe.
    """

    describers: LiveDescribers
    identity: str
    parts: Sequence[int]

    def offer(self, inbox: Inbox, received: Received) -> None:
        """Put a frame in the inbox if a part of it is this describer's turn."""
        header = received.header
        whose = partial(self.describers.whose, header.sequence)
        own = [part for part in self.parts if whose(part) == self.identity]
        if own and not header.end:
            inbox.offer(ReceivedParts(received.key, header, received.payload, own))


class FrameDescriber:
    """Publishes the raw features of the parts of frames that it is given.

    Counts frames that are ``unreadable``, and as ``repeated`` those whose raw features are all
    published again.
    """

    def __init__(
        self,
        feature: Feature,
        model: str,
        outputs: Mapping[str, Mapping[int, CachedPublisher]],
        counts: Mapping[str, Counter[str]],
    ) -> None:
        """Describe by the feature of the model with this fingerprint, or by some parts of it.

        Publish to the outputs of each run, and count in the counts of each run. The outputs name
        the parts of the feature by their numbers, in order.
        """
        self._feature = feature
        self._model = model
        self._outputs = outputs
        self._counts = counts

    def handle(self, received: ReceivedParts) -> None:
        """Publish the raw features of parts of a frame; a descriptor is left to the featurizer.

        Raises:
            MessageError: it is no frame.
        """
        header, outputs = received.header, self._outputs[received.run]
        missing = [part for part in received.parts if not outputs[part].put_again(header)]
        if not missing:
            self._counts[received.run]["repeated"] += 1
            return
        message = FrameMessage.decode(received.payload)
        if message.image is None:
            return
        numbers = [list(outputs).index(part) for part in missing]
        raws: Mapping[int, Array] = {}
        try:
            raws = self._feature.parts_of_frame(frame_of(header, message), numbers)
        except FrameError:  # the featurizer will find the same, and say so
            self._counts[received.run]["unreadable"] += 1
        finally:  # after a defect, too: the featurizer waits
            for part, number in zip(missing, numbers, strict=True):
                raw = RawFeatureMessage(model=self._model, part=part, raw=raws.get(number))
                outputs[part].put(header, raw)
