"""The channel worker: it receives descriptors and publishes the candidates of its channels."""

import threading
import time
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from placefield.bus.candidate_messages import HaloMessage
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import CAPACITY, Inbox, Received
from placefield.bus.keys import Keys, Part
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.bus.refusing import count_refused
from placefield.bus.replay_cache import (
    LENGTH,
    CachedPublisher,
    ReplayCache,
    fetch_all,
    replicated_cache,
    serve_cache,
)
from placefield.bus.session import Bus, open_bus
from placefield.bus.streams import StreamFollower, Turn
from placefield.config import Config
from placefield.errors import ConfigError, FrameError, MessageError, OtherMapError
from placefield.features.descriptors import DescriptorModel
from placefield.maps.map import Map, fingerprint
from placefield_services.background_query import BackgroundQuery
from placefield_services.channel_streams import ChannelOutputs, ChannelStream, PendingFrame
from placefield_services.moments import cache_moments
from placefield_services.process import ServiceProcess, counting_failure
from placefield_services.prometheus import serve_metrics
from placefield_services.served_channels import ServedChannels

SERVICE = "channel"

_MOST_PENDING = 256  # messages
_ASK_FOR_S = 3.0

_LIVE_FEATURES = 4  # live descriptors of a run that may wait; older ones are dropped


def run_channels(
    placemap: Map,
    channels: Sequence[int],
    config: Config,
    stop: threading.Event,
    *,
    shard: int = 0,
    shards: int = 1,
) -> None:
    """Serve channels of a map, or one shard of each channel, until ``stop`` is set.

    Raises:
        ConfigError: the map has no such channel or has fewer places than shards, or the rule does
            not support its descriptors.
    """
    placemap.features.check_rule(config.matching.rule)
    for channel in channels:
        if channel >= len(placemap.channels):
            raise ConfigError(
                f"--channel {channel}: the map has channels 0 to {len(placemap.channels) - 1}"
            )
    served = ServedChannels(placemap, channels, config.matching, shard, shards)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        process.map = placemap.digest
        serve_metrics(config.monitoring, process.report)
        # All shards of a channel must match the same frames, so a shard may not drop one.
        inbox = Inbox(process.counts, live_capacity=_LIVE_FEATURES if shards == 1 else CAPACITY)
        outputs = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.feature, inbox.offer, process.counts[run])
            if shards > 1:
                bus.subscribe(keys.all_halos, inbox.offer, process.counts[run])
            cache_moments(bus, keys, process.counts[run])
            outputs[run] = _outputs(
                bus, keys, process.identity, config.matching.lag, process.counts[run]
            )
            process.answers[run] = outputs[run].candidates.cache
        worker = ChannelWorker(placemap.model, served, outputs, process.counts)
        served.warm_up()
        for channel in channels:
            process.declare_ready(Part(channel, shard, shards).identity(process.identity))
        process.serve(inbox, worker.accept, stop, work=worker.match, after_batch=worker.after_batch)


def _outputs(bus: Bus, keys: Keys, identity: str, lag: int, counts: Counter[str]) -> ChannelOutputs:
    # The cache holds frames under way, and frames that a restarted fuser may have to smooth.
    candidates = CachedPublisher(
        bus.publisher(keys.candidates(identity)), ReplayCache(2 * WINDOW + lag)
    )
    serve_cache(bus, keys.cache(keys.all_candidates), candidates.cache)
    halos = CachedPublisher(bus.publisher(keys.halo(identity)), ReplayCache())
    cache = keys.cache(keys.all_halos)
    serve_cache(bus, cache, halos.cache)
    features = replicated_cache(bus, keys.cache(keys.feature))
    return ChannelOutputs(
        candidates=candidates,
        fetch=BackgroundQuery(features.fetch),
        store=features.cache.store,
        halos=halos,
        fetch_halos=BackgroundQuery(lambda *asked: list(fetch_all(bus, cache, *asked))),
        counts=counts,
    )


@dataclass
class _ChannelRun:
    outputs: ChannelOutputs
    counts: Counter[str]
    follower: StreamFollower
    stream: ChannelStream | None = None
    is_joining: bool = False
    """Whether the stream began earlier, and its frames have not been fetched yet."""
    ask_until: float = 0.0
    """Until then missing frames may still be fetched, monotonic seconds."""
    pending: deque[tuple[Header, HaloMessage]] = field(
        default_factory=lambda: deque(maxlen=_MOST_PENDING)
    )
    """Partial results of a stream that has not begun here yet."""


@dataclass(frozen=True)
class _Accepted:
    """A frame to match, with the stream that was current when it came.

    A frame that is not awaited was answered before; it only updates the matchers.
    """

    run: _ChannelRun
    stream: ChannelStream
    header: Header
    descriptor: NDArray[np.float32] | None
    odometry_m: float | None
    is_awaited: bool = True


class ChannelWorker:
    """Matches streams of descriptors in one or more channels, one stream per run at a time.

    The frames of all runs are compared with the places together.
    """

    def __init__(
        self,
        model: DescriptorModel,
        channels: ServedChannels,
        outputs: Mapping[str, ChannelOutputs],
        counts: Mapping[str, Counter[str]],
    ) -> None:
        """Publish to the outputs of each run, and count in the counts of each run."""
        self._channels = channels
        self._descriptors = model
        self._model = fingerprint(model)
        self._runs = {
            run: _ChannelRun(
                outputs, counts[run], StreamFollower(counts[run], partial(self._join, run))
            )
            for run, outputs in outputs.items()
        }

    def accept(self, received: Received) -> list[_Accepted]:
        """Handle a message; return the frames to match, missed frames first.

        Raises:
            NotYet: missed frames have been queried, and the answer has not come.
        """
        header, run = received.header, self._runs[received.run]
        if received.key != Keys(received.run).feature:
            partials = HaloMessage.decode(received.payload)
            partials.check_map(self._channels.digest)
            self._receive(run, header, partials)
            return []
        observed = (None, None) if header.end else self._decode(received.payload)
        turn = run.follower.follow(header)
        if turn is Turn.DROPPED:
            return []
        run.outputs.store(header, received.payload)
        if turn is Turn.REPEATED:
            run.outputs.candidates.put_again(header)
            return []
        missed = self._missed(run, header) if turn is Turn.AFTER_GAP else []
        if missed is None:
            run.counts["out_of_order"] += 1
            return []
        assert run.stream is not None
        return [*missed, _Accepted(run, run.stream, header, *observed)]

    def _missed(self, run: _ChannelRun, header: Header) -> list[_Accepted] | None:
        """Fetch the frames of the gap before this one, and skip to the frame after it.

        None: not all frames could be fetched yet; the source will send this frame again.
        """
        first = max(run.follower.next, header.sequence - LENGTH)
        is_asked = run.is_joining or self._channels.needs_all or not header.live
        frames = self._fetch(run, header, first) if is_asked else []
        is_complete = len(frames) == header.sequence - first
        if not is_complete and not header.live and time.monotonic() < run.ask_until:
            return None
        # A live stream drops frames on purpose, so missing frames alone do not mean a loss.
        is_forgotten = not is_complete and (not header.live or (run.is_joining and not frames))
        if is_forgotten and run.stream is not None:
            run.stream.is_forgotten = True
        unknown = 0 if run.is_joining else header.sequence - run.follower.next - len(frames)
        run.follower.skip_to(header.sequence, gaps=max(unknown, 0))
        run.is_joining, run.ask_until = False, time.monotonic() + _ASK_FOR_S
        return frames

    def _receive(self, run: _ChannelRun, header: Header, partials: HaloMessage) -> None:
        """Pass on the partial results of another shard, or keep them for a later stream."""
        if run.stream is not None and header.stream == run.follower.stream:
            run.stream.receive(header, partials)
        else:
            run.pending.append((header, partials))

    def _join(self, name: str, header: Header) -> int:
        """Begin a stream; return its first frame, which is earlier if the stream began before."""
        run = self._runs[name]
        first = max(0, header.sequence - LENGTH)
        run.stream = self._channels.new_stream(run.outputs, first)
        run.is_joining, run.ask_until = header.sequence > 0, time.monotonic() + _ASK_FOR_S
        pending = list(run.pending)
        run.pending.clear()
        for about, partials in pending:
            self._receive(run, about, partials)
        return first

    def _fetch(self, run: _ChannelRun, header: Header, first: int) -> list[_Accepted]:
        """Fetch the frames before this one from other replay caches."""
        assert run.stream is not None
        frames = []
        for old, payload in run.outputs.fetch(header.stream, first, header.sequence).values():
            is_awaited = not header.live and old.sequence >= header.oldest
            try:
                observed = self._decode(payload)
                run.outputs.store(old, payload)
                old = old.model_copy(update={"oldest": min(header.oldest, old.sequence)})
                frames.append(_Accepted(run, run.stream, old, *observed, is_awaited))
            except MessageError as error:
                count_refused(run.counts, error)
        run.counts["fetched"] += len(frames)
        return frames

    def _decode(self, payload: bytes) -> tuple[NDArray[np.float32] | None, float | None]:
        """Return the descriptor of a frame (None: a missing observation), and its odometry."""
        feature = FeatureMessage.decode(payload)
        if feature.model != self._model:
            raise OtherMapError(
                f"descriptor of model {feature.model!r}, but this channel's map has "
                f"{self._model}; give the featurizer the same map"
            )
        if feature.descriptor is None:
            return None, feature.odometry_m
        try:
            return self._descriptors.checked(feature.descriptor), feature.odometry_m
        except FrameError as error:
            raise MessageError(str(error)) from None

    def match(self, accepted: Sequence[Sequence[_Accepted]]) -> None:
        """Compare the frames with the places, and publish the candidates of all channels."""
        frames = list(chain.from_iterable(accepted))
        comparing = self._channels.comparing([frame.descriptor for frame in frames])
        for frame, compare in zip(frames, comparing, strict=True):
            with counting_failure([frame.run.counts]):
                frame.stream.add(
                    PendingFrame(frame.header, compare, frame.odometry_m, frame.is_awaited)
                )

    def after_batch(self, run: str) -> None:
        """Continue a run's stream after each batch of messages."""
        stream = self._runs[run].stream
        if stream is not None:
            stream.after_batch()
