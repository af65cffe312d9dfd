"""The featurizer: frames in, descriptors out."""

import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from placefield.bus.history import LENGTH, History, Outbox, Recall, recalling, share
from placefield.bus.inbox import Inbox, Received
from placefield.bus.messages import FeatureMessage, FrameMessage, Header, MomentsMessage
from placefield.bus.session import Publisher, open_bus
from placefield.bus.streams import StreamFollower, Turn
from placefield.config import Config
from placefield.errors import FrameError
from placefield.features.descriptors import DescriptorModel, DescriptorStream, Moments
from placefield.features.extract import feature_of_model
from placefield.maps.map import Map, fingerprint
from placefield_services.process import ServiceProcess

SERVICE = "featurizer"

_LARGE = (2160, 3840, 3)  # frame; 25 MB
_ANY = 2**48  # no frame has a higher number
_LIVE_FRAMES = 2  # of a run, that may wait: older ones are dropped


def run_featurizer(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set."""
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        inbox = Inbox(process.counts, live_capacity=_LIVE_FRAMES)
        outlets = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.frame, inbox.offer, process.counts[run])
            features = Outbox(bus.publisher(keys.feature), History())
            process.answers[run] = features.history
            share(bus, keys.history(keys.feature), features.history)
            outlets[run] = Outlet(
                features,
                bus.publisher(keys.moments),
                recalling(bus, keys.history(keys.feature)),
                recalling(bus, keys.history(keys.moments)),
            )
        featurizer = Featurizer(placemap.model, outlets, process.counts)
        featurizer.rehearse()
        with process.sole():
            # Frames share no work; one that waits may still make room for a newer one.
            process.serve(inbox, featurizer.handle, stop, at_once=1)


@dataclass(frozen=True)
class Outlet:
    """Where a featurizer publishes what it makes of a run, and asks what another has made."""

    features: Outbox
    moments: Publisher
    recall_features: Recall
    recall_moments: Recall


@dataclass
class _Run:
    outlet: Outlet
    counts: Counter[str]
    follower: StreamFollower
    descriptors: DescriptorStream


class Featurizer:
    """Makes each frame of a stream into its descriptor, in one stream per run at a time.

    Counts ``unreadable`` frames; they go on as frames that were not seen, so that none is missing.
    In a lossless stream no frame is taken before those before it: one that comes too ``early`` will
    be sent again.
    """

    def __init__(
        self,
        model: DescriptorModel,
        outlets: Mapping[str, Outlet],
        counts: Mapping[str, Counter[str]],
    ) -> None:
        """Publish and count by run."""
        self._model = model
        self._feature = feature_of_model(model)
        self._fingerprint = fingerprint(model)
        self._runs = {
            run: _Run(
                outlet,
                counts[run],
                StreamFollower(counts[run], partial(self._join, run)),
                DescriptorStream(model),
            )
            for run, outlet in outlets.items()
        }

    def rehearse(self) -> None:
        """Describe a frame of no stream, so that what is made at its first use is made.

        It is a large one: by the largest block that was freed, glibc tells how much memory to keep
        for the next frame rather than to return. Else each would be paid for anew, page by page.
        """
        frame = np.zeros(_LARGE, np.uint8)
        self._feature.describe(frame)
        frame.flags.writeable = False  # as frames of pixels come from the bus
        self._feature.describe(frame)

    def handle(self, received: Received) -> None:
        """Take a frame, publish its descriptor."""
        header, run = received.header, self._runs[received.run]
        frame = None if header.end else FrameMessage.decode(received.payload)
        turn = run.follower.follow(header)
        if turn is Turn.AHEAD and header.live:
            run.follower.leap(header.sequence)
            turn = Turn.NEXT
        if turn is Turn.AHEAD:
            run.counts["early"] += 1
        if turn is Turn.NEXT:
            self._publish(run, header, frame)
        if turn is Turn.REPEATED and not header.live:
            run.outlet.features.put_again(header)

    def _join(self, name: str, header: Header) -> int:
        """Begin a stream, or go on with one where the featurizer before this one was ended."""
        run = self._runs[name]
        run.descriptors = DescriptorStream(self._model)
        if header.sequence == 0:
            return 0
        first = max(0, header.sequence - LENGTH)
        features = run.outlet.recall_features(header.stream, first, _ANY)
        for feature in features.values():
            run.outlet.features.history.remember(*feature)
        made = max(features, default=header.oldest - 1)
        moments = run.outlet.recall_moments(header.stream, first, made + 1)
        if moments:
            last = MomentsMessage.decode(moments[max(moments)][1])
            run.descriptors = DescriptorStream(self._model, Moments(last.frames, last.sums))
        return header.sequence if header.live else max(made + 1, header.oldest)

    def _publish(self, run: _Run, header: Header, frame: FrameMessage | None) -> None:
        feature = None if frame is None else self._describe(run, frame)
        if self._model.standardise and feature is not None:  # before what was made with them
            moments = run.descriptors.moments
            message = MomentsMessage(frames=moments.frames, sums=moments.sums)
            run.outlet.moments.put(header, message)
        run.outlet.features.put(header, feature)

    def _describe(self, run: _Run, frame: FrameMessage) -> FeatureMessage:
        try:
            raw = self._feature.describe(frame.image)
        except FrameError:
            run.counts["unreadable"] += 1
            return FeatureMessage(model=self._fingerprint, descriptor=None)
        return FeatureMessage(model=self._fingerprint, descriptor=run.descriptors.push(raw))
