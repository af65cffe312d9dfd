"""The fuser: candidates in, one match per frame out."""

import math
import threading
import time
from collections import Counter, deque
from functools import partial

from placefield.bus.credits import WINDOW
from placefield.bus.history import MOMENTS, History, Memory, Outbox, remembering, share
from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys
from placefield.bus.messages import (
    CandidatesMessage,
    FeatureMessage,
    Header,
    MatchMessage,
    MomentsMessage,
)
from placefield.bus.session import Publisher, open_bus
from placefield.bus.streams import Arrival, StreamSwitch
from placefield.config import Config
from placefield.errors import MessageError
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.joiner import Joined, Joiner
from placefield.fusion.match import Match
from placefield.maps.map import Map
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield_services.live_channels import LiveChannels
from placefield_services.metrics import serve_metrics
from placefield_services.process import ServiceProcess, counting_failure

SERVICE = "fuser"

# Candidates of a stream that is not on yet, at most.
_EARLY = 256
_EARLY_BYTES = 2**28


def run_fuser(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set; ready when all channels are, or the bus's time-out is over."""
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        serve_metrics(config.monitoring, process.tell)
        process.channels = len(placemap.channels)
        inbox = Inbox(process.counts)
        fusers = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.feature, inbox.offer, process.counts[run])
            bus.subscribe(keys.all_candidates, inbox.offer, process.counts[run])
            channels = LiveChannels(len(placemap.channels))
            bus.watch_alive(keys.all_alive("channel"), channels.change)
            features = remembering(bus, keys.history(keys.feature))
            moments = remembering(bus, keys.history(keys.moments), MOMENTS)
            bus.subscribe(keys.moments, partial(_remember, moments.history), process.counts[run])
            matches = Outbox(bus.publisher(keys.match), History())
            process.answers[run] = matches.history
            share(bus, keys.history(keys.match), matches.history)
            outlets = matches, bus.publisher(keys.ack)
            fusers[run] = Fuser(
                placemap, config, keys, channels, (features, moments), *outlets, process.counts[run]
            )
        FusionStage(placemap.places.count, config.matching).rehearse()
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
                settle=lambda run: fusers[run].release(),
            )


def _remember(history: History, received: Received) -> None:
    MomentsMessage.decode(received.payload)
    history.remember(received.header, received.payload)


class Fuser:
    """Joins the candidates of a run's stream and answers each frame once, with what came in time.

    The stream ends when the featurizer has said so and every frame has been answered.
    """

    def __init__(
        self,
        placemap: Map,
        config: Config,
        keys: Keys,
        channels: LiveChannels,
        memories: tuple[Memory, Memory],
        matches: Outbox,
        acks: Publisher,
        counts: Counter[str],
    ) -> None:
        self._map = placemap
        self._config = config
        self._stage = FusionStage(placemap.places.count, config.matching)
        self._feature_key = keys.feature
        self.channels = channels
        self._memories = memories
        self._matches = matches
        self._acks = acks
        self._counts = counts
        self._switch = StreamSwitch(counts)
        self._early: deque[Received] = deque()
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
        self._headers: dict[int, Header] = {}
        self._end: Header | None = None

    def handle(self, received: Received) -> None:
        """Take a descriptor, which announces a frame, or candidates.

        Only descriptors begin a stream; candidates that are faster wait for it.
        """
        header = received.header
        is_feature = received.key == self._feature_key
        message = None if header.end else self._decode(received)
        if is_feature and not self._follow(received):
            return
        if self._switch.has_left(header.stream):
            self._counts["stale"] += 1
            return
        if header.stream != self._switch.stream:
            self._keep_early(received)
            return
        if not header.live:
            self._joiner.skip_to(header.oldest)
            if header.sequence > self._joiner.next + 2 * WINDOW:  # none is under way
                self._counts["early"] += 1
                return
        if not self._joiner.is_released(header.sequence):
            self._headers[header.sequence] = header
        now = time.monotonic()
        if isinstance(message, CandidatesMessage):
            self._add(header.sequence, message, now)
        elif header.end and is_feature:
            self._end = header
        elif is_feature:
            self._joiner.announce(header.sequence, now)

    def _follow(self, received: Received) -> bool:
        """Enter the stream of a descriptor; False if it was left."""
        header = received.header
        arrival = self._switch.enter(header.stream)
        if arrival is Arrival.DROPPED:
            return False
        if arrival is Arrival.NEW_STREAM:
            self._release(math.inf)  # what the stream before it still owes
            self._begin(header.oldest, live=header.live)
            if header.sequence > 0:  # others may forget what they know of it
                for memory in self._memories:
                    memory.fill(header)
            early, self._early = self._early, deque()
            for candidates in early:
                try:
                    self.handle(candidates)
                except MessageError:  # it must not cost the descriptor
                    self._counts["malformed"] += 1
        features, _ = self._memories
        came_again = features.history.find(header) is not None
        features.history.remember(header, received.payload)
        if came_again and self._joiner.is_released(header.sequence) and not header.live:
            self._answer_again(header)
        return True

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
        if self._matches.put_again(header):
            self._acks.put(header)

    def _decode(self, received: Received) -> FeatureMessage | CandidatesMessage:
        if received.key == self._feature_key:
            return FeatureMessage.decode(received.payload)
        message = CandidatesMessage.decode(received.payload)
        rule = self._config.matching.rule
        if message.rule != rule:
            raise MessageError(
                f"candidate of rule {message.rule}, this fuser's is {rule}: give both one --rule"
            )
        for each in message.candidates:  # a message is taken as a whole or not at all
            self._check(each.candidate, message.shards)
        return message

    def _check(self, candidate: Candidate, shards: int) -> None:
        if not self._stage.fits(candidate, shards):
            places = self._map.places.count
            raise MessageError(f"candidate of another map: this fuser's has {places} places")

    def release(self) -> None:
        """Publish the matches of frames that are complete or due, and the last one's credit."""
        self._joiner.set_alive(self.channels.alive)
        self._release(time.monotonic())

    def _release(self, now: float) -> None:
        last = None
        for joined in self._joiner.release(now):
            last = self._headers[joined.sequence]
            self._publish(last, joined)
        if last is not None:
            self._forget_before(last.sequence)
        if self._end is not None and self._is_over(self._end):
            last, self._end = self._end, None
            self._matches.put(last)
        if last is not None:  # stands for all before it
            self._acks.put(last)

    def _forget_before(self, sequence: int) -> None:
        self._shards.forget_before(sequence)
        for old in [old for old in self._headers if old < sequence]:
            del self._headers[old]

    def _is_over(self, end: Header) -> bool:
        """Whether all frames are answered: of a lossless stream, those not heard of yet, too."""
        return not self._joiner.pending and (end.live or self._joiner.next >= end.sequence)

    def _publish(self, header: Header, joined: Joined) -> None:
        match = self._fuse(joined)
        answered = match.place != UNANSWERED
        message = MatchMessage(
            place=match.place,
            score=match.score,
            missing=match.missing,
            probability=match.probability,
            known=match.known,
            pose=self._map.places.pose(match.place) if answered else None,
        )
        self._matches.put(header, message)
        self._counts["matches"] += 1

    def _fuse(self, joined: Joined) -> Match:
        """Make one match of a frame's candidates; a defect costs its answer, and no other's."""
        with counting_failure([self._counts]):
            candidates = list(joined.candidates.values())
            return self._stage.fuse(candidates, joined.missing)
        return Match(UNANSWERED, 0.0, tuple(self.channels.all))
