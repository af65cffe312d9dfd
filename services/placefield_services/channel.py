"""The channel worker: descriptors in, a candidate per channel out."""

import threading
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import channel_identity
from placefield.bus.messages import CandidateMessage, FeatureMessage, Header
from placefield.bus.session import Publisher, open_bus
from placefield.bus.streams import Arrival, StreamFollower
from placefield.config import Config, MatchingConfig
from placefield.errors import ConfigError, MessageError
from placefield.maps.map import Map, MapMetric, fingerprint
from placefield.matching.candidate import Candidate
from placefield.matching.channel_matcher import ChannelMatcher, matcher_of
from placefield.matching.comparing import Comparison, MetricPlaces
from placefield_services.process import ServiceProcess

SERVICE = "channel"

_LONGEST = 1.001  # descriptor; they have length 1, or 0 where there is nothing to see
_LIVE_FEATURES = 4  # of a run, that may wait: older ones are dropped


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
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        inbox = Inbox(process.counts, live_capacity=_LIVE_FEATURES)
        publishers = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.feature, inbox.offer, process.counts[run])
            publishers[run] = {number: bus.publisher(keys.candidate(number)) for number in channels}
        worker = ChannelWorker(placemap, channels, publishers, config.matching, process.counts)
        worker.rehearse()
        for channel in channels:
            process.declare_ready(channel_identity(channel, process.identity))
        process.serve(inbox, worker.accept, stop, work=worker.match)


@dataclass
class _Run:
    publishers: Mapping[int, Publisher]
    follower: StreamFollower
    stream: "_Stream | None" = None


@dataclass(frozen=True)
class _Frame:
    """A frame to match, in the stream that was on when it came."""

    publishers: Mapping[int, Publisher]
    stream: "_Stream"
    header: Header
    descriptor: NDArray[np.float32] | None


class ChannelWorker:
    """Matches streams of descriptors in one or more channels, one stream per run at a time.

    The frames of all runs are compared with the places together.
    """

    def __init__(
        self,
        placemap: Map,
        channels: Sequence[int],
        publishers: Mapping[str, Mapping[int, Publisher]],
        matching: MatchingConfig,
        counts: Mapping[str, Counter[str]],
    ) -> None:
        """Publish by run and channel, count by run."""
        self._channels = {number: placemap.channels[number] for number in channels}
        metrics = dict.fromkeys(channel.metric for channel in self._channels.values())
        self._places = {
            metric: MetricPlaces(metric, exact=matching.compares_exactly) for metric in metrics
        }
        self._dimensions = len(placemap.model.components)
        self._model = fingerprint(placemap.model)
        self._matching = matching
        self._runs = {
            run: _Run(own, StreamFollower(counts[run])) for run, own in publishers.items()
        }

    def rehearse(self) -> None:
        """Match frames of no stream, so that what is made at its first use is made."""
        frame = np.eye(1, self._dimensions, dtype=np.float32)[0]
        stream = self._new_stream(0)
        for sequence, compared in enumerate(self._compare([frame, -frame, frame])):
            stream.push(2 * sequence, compared)

    def accept(self, received: Received) -> _Frame | None:
        """Take a descriptor; none is returned for one that came before."""
        header, run = received.header, self._runs[received.run]
        descriptor = None if header.end else self._decode(received.payload)
        arrival = run.follower.follow(header)
        if arrival is Arrival.DROPPED:
            return None
        if run.stream is None or arrival is Arrival.NEW_STREAM:
            run.stream = self._new_stream(header.sequence)
        return _Frame(run.publishers, run.stream, header, descriptor)

    def _decode(self, payload: bytes) -> NDArray[np.float32] | None:
        feature = FeatureMessage.decode(payload)
        if feature.model != self._model:
            raise MessageError(
                f"descriptor of model {feature.model}; this channel's map has {self._model}: "
                "give the featurizer the same map"
            )
        descriptor = feature.descriptor
        if descriptor is None:
            return None
        if len(descriptor) != self._dimensions:
            raise MessageError(f"descriptor of {len(descriptor)}, not {self._dimensions} values")
        length = float(np.linalg.norm(descriptor.astype(np.float64)))
        if length > _LONGEST:  # what overflows once would spoil all sums of the stream
            raise MessageError(f"descriptor of length {length:.3g}, not 1")
        return descriptor

    def _new_stream(self, first: int) -> "_Stream":
        rule, reverse = self._matching.rule, self._matching.reverse
        matchers = {
            number: (channel.metric, matcher_of(channel, rule, reverse=reverse))
            for number, channel in self._channels.items()
        }
        return _Stream(matchers, first)

    def match(self, frames: Sequence[_Frame]) -> None:
        """Publish a candidate of each channel for each frame."""
        compared = self._compare([f.descriptor for f in frames if f.descriptor is not None])
        for frame in frames:
            if frame.header.end:
                for publisher in frame.publishers.values():
                    publisher.put(frame.header)
            else:
                seen = {} if frame.descriptor is None else next(compared)
                self._publish(frame, frame.stream.push(frame.header.sequence, seen))

    def _compare(
        self, descriptors: Sequence[NDArray[np.float32]]
    ) -> Iterator[dict[MapMetric, Comparison]]:
        """Yield how each descriptor compares with the places, under each metric."""
        if descriptors:
            stacked = np.stack(descriptors)
            by_metric = [places.compare(stacked) for places in self._places.values()]
            for comparisons in zip(*by_metric, strict=True):
                yield dict(zip(self._places, comparisons, strict=True))

    def _publish(self, frame: _Frame, candidates: Mapping[int, Candidate]) -> None:
        for number, candidate in candidates.items():
            message = CandidateMessage(
                rule=self._matching.rule,
                channel=number,
                place=candidate.place,
                score=candidate.score,
                places=candidate.places,
                evidence=candidate.evidence,
            )
            frame.publishers[number].put(frame.header, message)


class _Stream:
    """One stream in all channels of a worker.

    A frame that did not come is matched as one that was not seen: the vehicle has moved on.
    """

    def __init__(
        self, matchers: Mapping[int, tuple[MapMetric, ChannelMatcher]], first: int
    ) -> None:
        """Take each channel's metric and new matcher, and the number of the first frame."""
        self._matchers = matchers
        self._next = first

    def push(self, sequence: int, compared: Mapping[MapMetric, Comparison]) -> dict[int, Candidate]:
        """Return each channel's candidate for a frame; empty comparisons: it was not seen."""
        gap, self._next = sequence - self._next, sequence + 1
        candidates = {}
        for number, (metric, matcher) in self._matchers.items():
            for _ in range(min(gap, matcher.memory)):
                matcher.push(None)
            candidates[number] = matcher.push(compared.get(metric))
        return candidates
