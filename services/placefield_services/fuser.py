"""The fuser: candidates in, one match per frame out."""

import math
import threading
import time
from collections import Counter

import numpy as np

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys, channel_of, service_and_identity
from placefield.bus.messages import CandidateMessage, FeatureMessage, Header, MatchMessage
from placefield.bus.session import Publisher, open_bus
from placefield.bus.streams import Arrival, StreamSwitch
from placefield.config import Config, MatchingConfig
from placefield.errors import MessageError
from placefield.fusion.joiner import Joined, Joiner
from placefield.fusion.rules import fuse
from placefield.maps.map import Map
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield_services.process import ServiceProcess

SERVICE = "fuser"


def run_fuser(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set; ready when all channels are, or the bus's time-out is over."""
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        inbox = Inbox(process.counts)
        fusers = {}
        for run, keys in process.keys.items():
            bus.subscribe(keys.feature, inbox.offer, process.counts[run])
            bus.subscribe(keys.all_candidates, inbox.offer, process.counts[run])
            channels = LiveChannels(len(placemap.channels))
            bus.watch_alive(keys.all_alive("channel"), channels.change)
            publishers = bus.publisher(keys.match), bus.publisher(keys.ack)
            fusers[run] = Fuser(placemap, config, channels, *publishers, process.counts[run])
        rehearse(placemap.places.count, config.matching)
        end = time.monotonic() + config.bus.connect_timeout_s
        for fuser in fusers.values():
            fuser.channels.wait_for_all(end - time.monotonic(), stop)
        with process.sole():
            process.serve(
                inbox,
                lambda received: fusers[received.run].handle(received),
                stop,
                settle=lambda run: fusers[run].release(),
            )


def rehearse(count: int, matching: MatchingConfig) -> None:
    """Fuse a candidate of no frame, so that what is made at its first use is made."""
    places = np.arange(count, dtype=np.int32)
    belief = np.full(count, 1 / count, np.float32)
    fuse([Candidate(0, float(belief[0]), places, belief)], matching)


class LiveChannels:
    """Which channels of the map have a living worker, from liveliness tokens."""

    def __init__(self, count: int) -> None:
        self.all = range(count)
        self.alive: frozenset[int] = frozenset()
        """The channels with a worker now."""
        self._tokens: set[tuple[int, str]] = set()
        self._changed = threading.Condition()

    def change(self, key: str, is_alive: bool) -> None:
        """Take the birth or death of a worker's token."""
        _, identity = service_and_identity(key)
        channel = channel_of(identity)
        if channel is None:
            return
        with self._changed:
            (self._tokens.add if is_alive else self._tokens.discard)((channel, identity))
            self.alive = frozenset(channel for channel, _ in self._tokens)
            self._changed.notify_all()

    def wait_for_all(self, timeout: float, stop: threading.Event) -> None:
        """Wait until every channel has a worker, at most ``timeout`` seconds."""
        end = time.monotonic() + timeout
        while not self.alive.issuperset(self.all) and not stop.is_set():
            remaining = end - time.monotonic()
            if remaining <= 0:
                return
            with self._changed:
                self._changed.wait(min(remaining, 0.1))


class Fuser:
    """Joins the candidates of a run's stream and answers each frame once, with what came in time.

    The stream ends when the featurizer has said so and every frame has been answered.
    """

    def __init__(
        self,
        placemap: Map,
        config: Config,
        channels: LiveChannels,
        matches: Publisher,
        acks: Publisher,
        counts: Counter[str],
    ) -> None:
        self._map = placemap
        self._config = config
        self.channels = channels
        self._matches = matches
        self._acks = acks
        self._counts = counts
        self._switch = StreamSwitch(counts)
        self._begin(live=False)

    def _begin(self, *, live: bool) -> None:
        self._joiner = Joiner(
            self.channels.all, self._config.fusion.deadline_s, self._counts, gaps_expected=live
        )
        self._headers: dict[int, Header] = {}
        self._end: Header | None = None

    def handle(self, received: Received) -> None:
        """Take a descriptor, which announces a frame, or a candidate."""
        header = received.header
        message = None if header.end else self._decode(received)
        arrival = self._switch.enter(header.stream)
        if arrival is Arrival.DROPPED:
            return
        if arrival is Arrival.NEW_STREAM:
            self._release(math.inf)  # what the stream before it still owes
            self._begin(live=header.live)
        now = time.monotonic()
        if isinstance(message, FeatureMessage):
            self._joiner.announce(header.sequence, now)
        elif isinstance(message, CandidateMessage):
            candidate = Candidate(message.place, message.score, message.places, message.evidence)
            self._joiner.add(header.sequence, message.channel, candidate, now)
        elif _is_of_featurizer(received):
            self._end = header
        if self._joiner.is_pending(header.sequence):
            self._headers[header.sequence] = header

    def _decode(self, received: Received) -> FeatureMessage | CandidateMessage:
        if _is_of_featurizer(received):
            return FeatureMessage.decode(received.payload)
        message = CandidateMessage.decode(received.payload)
        rule, places = self._config.matching.rule, self._map.places.count
        if message.rule != rule:
            raise MessageError(
                f"candidate of rule {message.rule}, this fuser's is {rule}: give both one --rule"
            )
        if message.place >= places or not _fits(message, places):
            raise MessageError(f"candidate of another map: this fuser's has {places} places")
        return message

    def release(self) -> None:
        """Publish the matches of frames that are complete or due, and the last one's credit."""
        self._joiner.set_alive(self.channels.alive)
        self._release(time.monotonic())

    def _release(self, now: float) -> None:
        last = None
        for joined in self._joiner.release(now):
            last = self._headers.pop(joined.sequence)
            self._publish(last, joined)
        if self._end is not None and not self._joiner.pending:
            last, self._end = self._end, None
            self._matches.put(last)
        if last is not None:  # stands for all before it
            self._acks.put(last)

    def _publish(self, header: Header, joined: Joined) -> None:
        match = fuse(
            list(joined.candidates.values()), self._config.matching, missing=joined.missing
        )
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


def _is_of_featurizer(received: Received) -> bool:
    return received.key == Keys(received.run).feature


def _fits(message: CandidateMessage, count: int) -> bool:
    """Whether the evidence is what the rule has, of a map of so many places."""
    places, evidence = message.places, message.evidence
    if message.rule == "lowest-score" or message.place == UNANSWERED:
        return len(places) == len(evidence) == 0
    if message.rule == "evidence":
        return len(places) == 0 and len(evidence) == count
    is_ascending = bool((np.diff(places, prepend=-1, append=count) > 0).all())
    return is_ascending and len(places) == len(evidence) > 0
