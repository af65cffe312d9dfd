"""A channel worker without a bus, and its expected answers."""

from collections import Counter
from collections.abc import Sequence
from itertools import zip_longest
from typing import get_args

import numpy as np
from bus_doubles import PeerCache, RecordingPublisher, header, received
from numpy.typing import NDArray

from placefield.bus.candidate_messages import (
    CandidatesMessage,
    FinishedMessage,
    HaloMessage,
    SmoothedFrame,
)
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage, MatchMessage
from placefield.bus.replay_cache import CachedPublisher, ReplayCache
from placefield.config import MatchingConfig, Rule
from placefield.maps.map import Map, fingerprint
from placefield.matching.channel_stage import ChannelStage
from placefield.matching.comparing import MetricPlaces
from placefield.matching.sharding import ChannelShard
from placefield_services.channel_outputs import ChannelOutputs
from placefield_services.channel_worker import ChannelWorker
from placefield_services.served_channels import ServedChannels

RUNS = ("day", "night")


RULES: tuple[Rule, ...] = get_args(Rule)
Descriptor = NDArray[np.float32]
SmoothedCandidate = tuple[int, int, int, float, bytes, bytes]
"""Sequence, lag, place, score, places and evidence."""

ChannelAnswer = tuple[int, int, float, bytes, bytes]
"""Sequence, place, score, places and evidence of a candidate."""


class Stage:
    """A channel worker of two runs, with its published messages and its counts."""

    def __init__(
        self,
        placemap: Map,
        rule: Rule,
        channels: tuple[int, ...] = (0, 2),
        *,
        reverse: bool = False,
    ) -> None:
        self.model = fingerprint(placemap.model)
        self.channels = channels
        self.publishers = {
            run: RecordingPublisher(CandidatesMessage, FinishedMessage) for run in RUNS
        }
        self.elsewhere = {run: PeerCache() for run in RUNS}
        self.remembered = {run: ReplayCache() for run in RUNS}
        self.counts: dict[str, Counter[str]] = {run: Counter() for run in RUNS}
        self._matching = matching = MatchingConfig(rule=rule, reverse=reverse)
        outputs = {run: self._outputs(run) for run in RUNS}
        served = ServedChannels(placemap, channels, matching)
        served.warm_up()
        self._worker = ChannelWorker(served, outputs, self.counts)

    def _outputs(self, run: str) -> ChannelOutputs:
        return ChannelOutputs(
            candidates=CachedPublisher(self.publishers[run], ReplayCache()),
            fetch=self.elsewhere[run].fetch,
            features=self.remembered[run],
            halos=CachedPublisher(RecordingPublisher(HaloMessage), ReplayCache()),
            fetch_halos=lambda *_: [],
            counts=self.counts[run],
        )

    def feature(
        self,
        about: Header,
        descriptor: Descriptor | None = None,
        *,
        run: str = RUNS[0],
        odometry_m: float | None = None,
    ) -> Received:
        message = FeatureMessage(model=self.model, descriptor=descriptor, odometry_m=odometry_m)
        return received(Keys(run).feature, about, b"" if about.end else message)

    def remember_elsewhere(
        self,
        descriptors: list[Descriptor],
        *,
        live: bool = False,
        odometry_m: Sequence[float | None] = (),
    ) -> None:
        """Fill the replay cache of another service with a stream."""
        for sequence, (descriptor, reading) in enumerate(zip_longest(descriptors, odometry_m)):
            message = FeatureMessage(model=self.model, descriptor=descriptor, odometry_m=reading)
            self.elsewhere[RUNS[0]].kept[sequence] = header(sequence, live=live), message.encode()

    def handle(self, *batch: Received) -> None:
        self._worker.match([self._worker.accept(message) for message in batch])

    def send(self, about: Header, descriptor: Descriptor | None) -> None:
        self.handle(self.feature(about, descriptor))

    def offer(self, version: Map) -> None:
        """Let the worker have a new version of the map."""
        self._worker.offer(ServedChannels(version, self.channels, self._matching))

    def after_batch(self, *, answering: str | None = None, run: str = RUNS[0]) -> None:
        """Let the worker go on, after a match of the map ``answering`` if that is given."""
        if answering is not None:
            match = MatchMessage(map=answering, place=0, score=0.0)
            self._worker.answering[run].receive(received(Keys(run).match, header(0), match))
        self._worker.after_batch(run)

    def answering(self, run: str = RUNS[0]) -> str:
        """Return the map that the worker answers by."""
        return self._worker.newest_answers(run)[1]

    def candidates(
        self, channel: int, *, run: str = RUNS[0], of: str | None = None
    ) -> list[ChannelAnswer]:
        """Return the published candidates of a channel, of one map or of any."""
        return [
            (about.sequence, each.place, each.score, each.places.tobytes(), each.evidence.tobytes())
            for about, message in self.publishers[run].sent
            if isinstance(message, CandidatesMessage) and of in (None, message.map)
            for each in message.candidates
            if each.channel == channel
        ]

    def smoothed(
        self, channel: int, *, run: str = RUNS[0], first: int = 0, of: str | None = None
    ) -> list[SmoothedCandidate]:
        """Return the published smoothed candidates of a channel, from message ``first`` on.

        ``of``: of one map, or of any.
        """
        return [
            _as_smoothed(each)
            for about, message in self.publishers[run].sent[first:]
            if isinstance(message, CandidatesMessage | FinishedMessage) and message.smoothed
            if of in (None, message.map)
            for each in message.smoothed.frames(about.sequence)
            if each.channel == channel
        ]


def _as_smoothed(frame: SmoothedFrame) -> SmoothedCandidate:
    candidate = frame.candidate
    arrays = candidate.places.tobytes(), candidate.evidence.tobytes()
    return frame.sequence, frame.lag, candidate.place, candidate.score, *arrays


def smoothed_offline(
    placemap: Map, channel: int, rule: Rule, descriptors: list[Descriptor | None]
) -> list[SmoothedCandidate]:
    """Return the smoothed candidates of a channel for a whole stream."""
    stage = ChannelStage({channel: placemap.channels[channel]}, MatchingConfig(rule=rule))
    stream = stage.new_stream()
    smoothed = []
    for descriptor in descriptors:
        stream.update(None if descriptor is None else next(stage.compare([descriptor])))
        smoothed += stream.smoothed()[channel]
    for _ in range(stream.end()):
        stream.update(None)
    stream.finish()
    smoothed += stream.smoothed()[channel]
    return [
        _as_smoothed(SmoothedFrame(channel, sequence, each.lag, each.candidate))
        for sequence, each in smoothed
    ]


def offline(
    placemap: Map,
    channel: int,
    rule: Rule,
    descriptors: list[Descriptor | None],
    *,
    reverse: bool = False,
) -> list[ChannelAnswer]:
    matching = MatchingConfig(rule=rule, reverse=reverse)
    matcher = ChannelShard(placemap.channels[channel], matching).new_matcher()
    places = MetricPlaces(placemap.channels[channel].metric, exact=False)
    candidates = [
        matcher.update(None if descriptor is None else next(iter(places.compare(descriptor[None]))))
        for descriptor in descriptors
    ]
    return [
        (s, c.place, c.score, c.places.tobytes(), c.evidence.tobytes())
        for s, c in enumerate(candidates)
    ]
