"""The fuser: candidates in, one match per frame out."""

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

from placefield.bus.candidate_messages import CandidatesMessage, FinishedMessage
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage, MatchMessage
from placefield.bus.refusing import count_refused
from placefield.bus.replay_cache import (
    CachedPublisher,
    ReplayCache,
    ReplicatedCache,
    fetch_all,
    replicated_cache,
    serve_cache,
)
from placefield.bus.session import Bus, Publisher, open_bus
from placefield.bus.streams import Arrival, StreamSwitch
from placefield.config import Config
from placefield.errors import MessageError
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.joiner import Joined, Joiner
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield_services.background_query import BackgroundQuery
from placefield_services.live_channels import LiveChannels
from placefield_services.moments import cache_moments
from placefield_services.process import ServiceProcess, counting_failure
from placefield_services.prometheus import serve_metrics
from placefield_services.smoothing import Smoothing

SERVICE = "fuser"

# Candidates of a stream that is not on yet, at most.
_EARLY = 256
_EARLY_BYTES = 2**28


def run_fuser(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set; ready when all channels are, or the bus's time-out is over.

    Raises:
        ConfigError: the rule does not follow the map's descriptors.
    """
    placemap.features.check_rule(config.matching.rule)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        process.map = placemap.digest
        serve_metrics(config.monitoring, process.report)
        process.channels = len(placemap.channels)
        inbox = Inbox(process.counts)
        fusers = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.feature, inbox.offer, process.counts[run])
            bus.subscribe(keys.all_candidates, inbox.offer, process.counts[run], ends_empty=False)
            channels = LiveChannels(len(placemap.channels))
            bus.watch_alive(keys.all_alive("channel"), channels.change)
            features = replicated_cache(bus, keys.cache(keys.feature))
            moments = cache_moments(bus, keys, process.counts[run])
            outputs = FuserOutputs(
                _shared(bus, keys, keys.match),
                _shared(bus, keys, keys.smoothed),
                bus.publisher(keys.ack),
            )
            process.answers[run] = outputs.matches.cache
            candidates = partial(fetch_all, bus, keys.cache(keys.all_candidates))
            fusers[run] = Fuser(
                placemap,
                config,
                keys,
                channels,
                FuserCaches(features, moments, candidates),
                outputs,
                process.counts[run],
            )
        FusionStage(placemap.places.same, config.matching).warm_up()
        end = time.monotonic() + config.bus.connect_timeout_s
        for fuser in fusers.values():  # a stream that is on is answered by the channels there are
            fuser.channels.wait_for_all(
                end - time.monotonic(), lambda: stop.is_set() or inbox.is_waiting
            )
        with process.sole():
            process.serve(
                inbox,
                lambda received: fusers[received.run].handle(received),
                stop,
                after_batch=lambda run: fusers[run].release(),
            )


def _shared(bus: Bus, keys: Keys, key: str) -> CachedPublisher:
    """Return what publishes on a key and shares what it remembers."""
    cache = ReplayCache()
    serve_cache(bus, keys.cache(key), cache)
    return CachedPublisher(bus.publisher(key), cache)


@dataclass(frozen=True)
class FuserCaches:
    """What a fuser remembers for others, and what others do for it.

    Attributes:
        features: descriptors of the stream.
        moments: of the stream.
        fetch_candidates: yields what channel workers have published of a stream, of frames from
            one up to another.
    """

    features: ReplicatedCache
    moments: ReplicatedCache
    fetch_candidates: Callable[[str, int, int], Iterable[tuple[Header, bytes]]]


@dataclass(frozen=True)
class FuserOutputs:
    """Where a fuser publishes matches, smoothed ones, and the headers of those answered."""

    matches: CachedPublisher
    smoothed: CachedPublisher
    acks: Publisher


class Fuser:
    """Joins the candidates of a run's stream and answers each frame once, with what came in time.

    The stream ends when the featurizer has said so and every frame has been answered. Its source is
    told so when all smoothed matches are out, too.
    """

    def __init__(
        self,
        placemap: Map,
        config: Config,
        keys: Keys,
        channels: LiveChannels,
        caches: FuserCaches,
        outputs: FuserOutputs,
        counts: Counter[str],
    ) -> None:
        self._map = placemap
        self._config = config
        self._stage = FusionStage(placemap.places.same, config.matching, placemap.places.pose)
        self._feature_key = keys.feature
        self.channels = channels
        self._caches = caches
        self._outputs = outputs
        self._counts = counts
        self._switch = StreamSwitch(counts)
        self._early: deque[Received] = deque()
        self._query = BackgroundQuery(self._fetch)
        self._begin(0, live=False)

    def _begin(self, first: int, *, live: bool) -> None:
        self._joiner = Joiner(
            self.channels.all,
            self._config.fusion.deadline_s,
            self._counts,
            first=first,
            gaps_expected=live,
        )
        self._shards = self._stage.new_joiner()
        self._smoothing = Smoothing(
            self._map, self._stage, self._config, self._outputs.smoothed, self._counts
        )
        self._headers: dict[int, Header] = {}
        self._end: Header | None = None

    def handle(self, received: Received) -> None:
        """Take a descriptor, which announces a frame, or candidates.

        Only descriptors begin a stream; candidates that are faster wait for it.

        Raises:
            NotYet: it is in the midst of a stream, and what others know of that has not come.
        """
        header = received.header
        is_feature = received.key == self._feature_key
        message = None if header.end and is_feature else self._decode(received)
        if is_feature and not self._follow(received):
            return
        if self._switch.has_left(header.stream):
            self._counts["stale"] += 1
            return
        if header.stream != self._switch.stream:
            self._keep_early(received)
            return
        if isinstance(message, FeatureMessage | CandidatesMessage) and message.forgotten:
            self._smoothing.is_forgotten = True  # and all frames after it, too
        if not header.live:
            self._skip_to(header)
            if header.sequence > self._joiner.next + 2 * WINDOW:  # none is under way
                self._counts["out_of_order"] += 1
                return
        now = time.monotonic()
        if isinstance(message, FinishedMessage | CandidatesMessage):
            self._smoothing.add(header.sequence, message, now)
        if header.end:
            self._end = header if is_feature else self._end
            return
        if not self._joiner.is_released(header.sequence):
            self._headers[header.sequence] = header
        if isinstance(message, CandidatesMessage):
            self._add(header.sequence, message, now)
        elif is_feature:
            self._joiner.announce(header.sequence, now)

    def _skip_to(self, header: Header) -> None:
        """Take frames that the source awaits no more as answered, by a fuser before this one."""
        if header.oldest > self._joiner.next:
            self._joiner.skip_to(header.oldest)
            self._smooth_answered(header.stream, header.oldest)

    def _smooth_answered(self, stream: str, end: int) -> None:
        """Smooth the newest frames before this one: the fuser that answered them may not have.

        Those that it had smoothed are published a second time.
        """
        first = max(0, end - self._smoothing.lag)
        for header in self._caches.features.cache.headers(stream, first, end):
            if not header.end:
                self._smoothing.announce(header)

    def _follow(self, received: Received) -> bool:
        """Enter the stream of a descriptor; False if it was left."""
        header = received.header
        is_on = self._switch.begins(header) and header.sequence > 0
        fetched = self._query(header.stream, header) if is_on else []
        arrival = self._switch.enter(header)
        if arrival is Arrival.DROPPED:
            return False
        if arrival is Arrival.NEW_STREAM:
            self._release(math.inf)  # what the stream before it still owes
            self._smoothing.abandon()
            self._begin(header.oldest, live=header.live)
            if is_on:
                self._go_on(header, fetched)
            early, self._early = self._early, deque()
            for candidates in early:
                try:
                    self.handle(candidates)
                except MessageError as error:  # it must not cost the descriptor
                    count_refused(self._counts, error)
        features = self._caches.features
        came_again = features.cache.find(header) is not None
        features.cache.store(header, received.payload)
        if came_again and self._joiner.is_released(header.sequence) and not header.live:
            self._answer_again(header)
        return True

    def _fetch(self, stream: str, header: Header) -> list[tuple[Header, bytes]]:
        """Learn what others know of a stream that was on, for they may forget it.

        Returns the candidates that may have to be smoothed. It is in a thread of its own.
        """
        self._caches.features.fill(header)
        self._caches.moments.fill(header)
        first = max(0, _answered(header) - self._smoothing.lag)
        fetch = self._caches.fetch_candidates
        return list(fetch(stream, first, header.sequence + 2 * WINDOW))

    def _go_on(self, header: Header, candidates: Iterable[tuple[Header, bytes]]) -> None:
        """Go on with a stream that was on."""
        self._smooth_answered(header.stream, _answered(header))
        now = time.monotonic()
        for old, payload in candidates:
            try:
                message = self._decode_candidates(old, payload)
                self._smoothing.add(old.sequence, message, now)
            except MessageError as error:
                count_refused(self._counts, error)

    def _keep_early(self, received: Received) -> None:
        self._early.append(received)
        held = sum(len(each.payload) for each in self._early)
        while len(self._early) > _EARLY or held > _EARLY_BYTES:
            held -= len(self._early.popleft().payload)
            self._counts["dropped_full"] += 1

    def _add(self, sequence: int, message: CandidatesMessage, now: float) -> None:
        whole = []
        for each in message.candidates:
            if each.channel not in self.channels.all:
                self._counts["unknown_channel"] += 1
                continue
            part = message.shard, message.shards
            joined = self._shards.add(sequence, each.channel, *part, each.candidate)
            if joined is not None:
                if message.shards > 1:  # a whole channel's was checked as it came
                    self._check(joined, 1)
                whole.append((each.channel, joined))
        for channel, candidate in whole:
            self._joiner.add(sequence, channel, candidate, now)

    def _answer_again(self, header: Header) -> None:
        """Publish the match of a frame whose source has not heard of it."""
        if self._outputs.matches.put_again(header):
            self._outputs.acks.put(header)

    def _decode(self, received: Received) -> FeatureMessage | CandidatesMessage | FinishedMessage:
        if received.key == self._feature_key:
            return FeatureMessage.decode(received.payload)
        return self._decode_candidates(received.header, received.payload)

    def _decode_candidates(
        self, header: Header, payload: bytes
    ) -> CandidatesMessage | FinishedMessage:
        kind = FinishedMessage if header.end else CandidatesMessage
        message = kind.decode(payload)
        message.check_map(self._map.digest)
        rule = self._config.matching.rule
        if message.rule != rule:
            raise MessageError(
                f"candidate of rule {message.rule}, this fuser's is {rule}: give both one --rule"
            )
        # A message is taken as a whole or not at all.
        self._smoothing.check(message)
        if isinstance(message, CandidatesMessage):
            for each in message.candidates:
                self._check(each.candidate, message.shards)
        return message

    def _check(self, candidate: Candidate, shards: int) -> None:
        if not self._stage.fits(candidate, shards):
            places = self._map.places.count
            raise MessageError(f"candidate of another map: this fuser's has {places} places")

    def release(self) -> None:
        """Publish the matches of frames that are complete or due, and the last one's credit.

        Smoothed ones likewise.
        """
        self._joiner.set_alive(self.channels.alive)
        self._release(time.monotonic())

    def _release(self, now: float) -> None:
        self._map.check_unchanged()  # poses of a map that was written to are nobody's
        last = None
        for joined in self._joiner.release(now):
            last = self._headers[joined.sequence]
            self._publish(last, joined)
            self._smoothing.announce(last)
        if last is not None:
            self._forget_before(last.sequence)
        self._smoothing.release()
        if self._end is not None and self._is_over(self._end):
            self._outputs.matches.put(self._end)
            self._smoothing.end(self._end, now)
            self._end = None
        last = self._smoothing.finish(self.channels.alive, now) or last
        if last is not None:  # stands for all before it
            self._outputs.acks.put(last)

    def _forget_before(self, sequence: int) -> None:
        self._shards.forget_before(sequence)
        for old in [old for old in self._headers if old < sequence]:
            del self._headers[old]

    def _is_over(self, end: Header) -> bool:
        """Whether all frames are answered: of a lossless stream, those not heard of yet, too."""
        return not self._joiner.pending and (end.live or self._joiner.next >= end.sequence)

    def _publish(self, header: Header, joined: Joined) -> None:
        match = replace(self._fuse(joined), forgotten=self._smoothing.is_forgotten)
        message = MatchMessage.of(match, map=self._map.digest)
        self._outputs.matches.put(header, message)
        self._counts["matches"] += 1
        if message.too_fast:
            self._counts["too_fast"] += 1

    def _fuse(self, joined: Joined) -> Match:
        """Make one match of a frame's candidates; a defect costs its answer, and no other's."""
        with counting_failure([self._counts]):
            candidates = list(joined.candidates.values())
            return self._stage.fuse(candidates, joined.missing)
        return Match(UNANSWERED, 0.0, tuple(self.channels.all))


def _answered(header: Header) -> int:
    """Return up to which frame a stream was answered, by the first of it that came."""
    return header.sequence if header.live else header.oldest
