"""The fuser: candidates in, one match per frame out."""

import math
import threading
import time
from collections import Counter

from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys, channel_of, service_and_identity
from placefield.bus.messages import CandidateMessage, FeatureMessage, Header, MatchMessage
from placefield.bus.session import Publisher, open_bus
from placefield.bus.streams import Arrival, StreamSwitch
from placefield.config import Config
from placefield.errors import MessageError
from placefield.fusion.joiner import Joined, Joiner
from placefield.fusion.rules import fuse
from placefield.maps.map import Map
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield_services.process import ServiceProcess

SERVICE = "fuser"


def run_fuser(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set; ready when all channels are, or the bus's time-out is over."""
    keys = Keys(config.run)
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, keys)
        inbox = Inbox(process.counts)
        bus.subscribe(keys.feature, inbox.offer, process.counts)
        bus.subscribe(keys.all_candidates, inbox.offer, process.counts)
        channels = LiveChannels(len(placemap.channels))
        bus.watch_alive(keys.all_alive("channel"), channels.change)
        fuser = Fuser(
            placemap,
            config,
            channels,
            bus.publisher(keys.match),
            bus.publisher(keys.ack),
            process.counts,
        )
        channels.wait_for_all(config.bus.connect_timeout_s, stop)
        with process.sole():
            process.serve(inbox, fuser.handle, stop, idle=fuser.release)


class LiveChannels:
    """Which channels of the map have a living worker, from liveliness tokens."""

    def __init__(self, count: int) -> None:
        self.all = range(count)
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
            self._changed.notify_all()

    @property
    def alive(self) -> frozenset[int]:
        """The channels with a worker now."""
        with self._changed:
            return frozenset(channel for channel, _ in self._tokens)

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
    """Joins the candidates of a stream and answers each frame once, with what came in time.

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
        self._channels = channels
        self._matches = matches
        self._acks = acks
        self._counts = counts
        self._feature_key = Keys(config.run).feature
        self._switch = StreamSwitch(counts)
        self._begin(live=False)

    def _begin(self, *, live: bool) -> None:
        self._joiner = Joiner(
            self._channels.all, self._config.fusion.deadline_s, self._counts, gaps_expected=live
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
            candidate = Candidate(message.place, message.score, message.evidence)
            self._joiner.add(header.sequence, message.channel, candidate, now)
        elif received.key == self._feature_key:
            self._end = header
        if self._joiner.is_pending(header.sequence):
            self._headers[header.sequence] = header

    def _decode(self, received: Received) -> FeatureMessage | CandidateMessage:
        if received.key == self._feature_key:
            return FeatureMessage.decode(received.payload)
        message = CandidateMessage.decode(received.payload)
        rule, places = self._config.matching.rule, self._map.places.count
        if message.rule != rule:
            raise MessageError(
                f"candidate of rule {message.rule}, this fuser's is {rule}: give both one --rule"
            )
        has_evidence = rule != "lowest-score" and message.place != UNANSWERED
        if message.place >= places or len(message.evidence) != (places if has_evidence else 0):
            raise MessageError(f"candidate of another map: this fuser's has {places} places")
        return message

    def release(self) -> None:
        """Publish the matches of frames that are complete or due, and their credits."""
        self._joiner.set_alive(self._channels.alive)
        self._release(time.monotonic())

    def _release(self, now: float) -> None:
        for joined in self._joiner.release(now):
            self._publish(self._headers.pop(joined.sequence), joined)
        if self._end is not None and not self._joiner.pending:
            self._matches.put(self._end)
            self._acks.put(self._end)
            self._end = None

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
        self._acks.put(header)
        self._counts["matches"] += 1
