"""A fuser without a bus, at a time of its own."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from bus_doubles import PeerCache, RecordingPublisher, at_last, received

from placefield.bus.candidate_messages import (
    CandidatesMessage,
    ChannelCandidate,
    FinishedMessage,
    SmoothedFrame,
    SmoothedFrames,
)
from placefield.bus.keys import Keys, Part
from placefield.bus.message import Header, Message
from placefield.bus.messages import FeatureMessage, MatchMessage, SmoothedMessage
from placefield.bus.replay_cache import CachedPublisher, ReplayCache, ReplicatedCache
from placefield.config import Config, Rule
from placefield.fusion.fusion_stage import FusionStage
from placefield.fusion.match import Match
from placefield.fusion.rules import fuse
from placefield.maps.map import Map
from placefield.matching.candidate import Candidate
from placefield_services.fuser_run import FuserCaches, FuserRun
from placefield_services.fusion_parts import RunParts
from placefield_services.live_channels import LiveChannels
from placefield_services.match_publisher import FuserOutputs
from placefield_services.served import FuserVersion

KEYS = Keys("test")
CANDIDATES = KEYS.candidates("worker")
DEADLINE_S = 2.0
LAG = 3
CHANNELS = 3


def version_of(placemap: Map, config: Config) -> FuserVersion:
    """Return a version of a map, as a fuser serves it."""
    stage = FusionStage(placemap.topology, config.matching, placemap.places.pose)
    return FuserVersion(placemap, stage)


class Clock:
    """Time that passes when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


class Stage:
    """A fuser, what it published and what it counted."""

    def __init__(self, placemap: Map, clock: Clock, rule: Rule = "filter") -> None:
        self.places = placemap.places.count
        self.map = placemap.digest
        self.config = Config.model_validate(
            {
                "runs": ["test"],
                "matching": {"rule": rule, "lag": LAG},
                "fusion": {"deadline_s": DEADLINE_S},
            }
        )
        self.channels = LiveChannels(CHANNELS)
        for channel in range(CHANNELS):
            self.set_alive(channel, True)
        self.matches, self.acks = RecordingPublisher(MatchMessage), RecordingPublisher(MatchMessage)
        self.smoothed_matches = RecordingPublisher(SmoothedMessage)
        self.features, self.elsewhere = ReplayCache(), PeerCache()
        self.remembered: list[tuple[Header, bytes]] = []
        """Messages of channel workers that they can send again."""
        unasked = ReplicatedCache(ReplayCache(), PeerCache().fetch)
        self.counts: Counter[str] = Counter()
        self._clock = clock
        outputs = FuserOutputs(
            CachedPublisher(self.matches, ReplayCache()),
            CachedPublisher(self.smoothed_matches, ReplayCache()),
            self.acks,
        )
        caches = FuserCaches(
            ReplicatedCache(self.features, self.elsewhere.fetch), unasked, self._fetch_candidates
        )
        parts = RunParts(self.config, self.channels, outputs, self.counts)
        self._fuser = FuserRun(version_of(placemap, self.config), KEYS, parts, caches)

    def _fetch_candidates(self, stream: str, first: int, end: int) -> list[tuple[Header, bytes]]:
        return [
            (about, payload)
            for about, payload in self.remembered
            if about.stream == stream and first <= about.sequence < end
        ]

    def offer(self, version: Map, is_there: Callable[[], bool] = lambda: True) -> None:
        """Let the fuser have a new version of the map."""
        self._fuser.offer(version_of(version, self.config), is_there)

    @property
    def answering(self) -> str:
        """The map that the fuser answers by."""
        return self._fuser.digest

    def set_alive(self, channel: int, is_alive: bool) -> None:
        token = KEYS.alive("channel", Part(channel).identity("worker"))
        self.channels.change(token, is_alive)

    def handle(self, key: str, about: Header, message: Message | bytes = b"") -> None:
        at_last(lambda: self._fuser.handle(received(key, about, message)))
        self._fuser.release()

    def announce(self, about: Header) -> None:
        self.handle(KEYS.feature, about, FeatureMessage(model="m", descriptor=None))

    def candidate(self, channel: int, sequence: int) -> Candidate:
        """Return a candidate with belief in some of the places."""
        rng = np.random.default_rng([channel, sequence])
        evidence = rng.dirichlet(np.full(self.places // 3, 0.1)).astype(np.float32)
        places = np.sort(rng.permutation(self.places)[: len(evidence)]).astype(np.int32)
        best = int(np.argmax(evidence))
        return Candidate(int(places[best]), float(evidence[best]), places, evidence)

    def written(self, channel: int, sequence: int, **changes: Any) -> ChannelCandidate:
        return ChannelCandidate(
            **(vars(self.candidate(channel, sequence)) | {"channel": channel} | changes)
        )

    def message(self, *candidates: ChannelCandidate, rule: Rule | None = None) -> CandidatesMessage:
        return CandidatesMessage(
            map=self.map, rule=rule or self.config.matching.rule, candidates=candidates
        )

    def answer(self, channels: int | tuple[int, ...], about: Header) -> None:
        """Let one worker answer, of one channel or several."""
        numbers = channels if isinstance(channels, tuple) else (channels,)
        candidates = [self.written(channel, about.sequence) for channel in numbers]
        self.handle(CANDIDATES, about, self.message(*candidates))

    def smoothed(self, channel: int, sequence: int, lag: int) -> SmoothedFrame:
        return SmoothedFrame(channel, sequence, lag, self.candidate(channel + 100, sequence))

    def message_of_smoothed(self, about: Header, *smoothed: SmoothedFrame) -> Message:
        """Return what a worker says of a frame, with what it has smoothed; or at the end."""
        packed = SmoothedFrames.of(about.sequence, smoothed)
        rule, channels = self.config.matching.rule, sorted({each.channel for each in smoothed})
        if about.end:
            return FinishedMessage(
                map=self.map,
                rule=rule,
                channels=tuple(channels or range(CHANNELS)),
                smoothed=packed,
            )
        candidates = [self.written(channel, about.sequence) for channel in channels]
        return CandidatesMessage(
            map=self.map, rule=rule, candidates=tuple(candidates), smoothed=packed
        )

    def smooth(self, about: Header, *smoothed: SmoothedFrame) -> None:
        self.handle(CANDIDATES, about, self.message_of_smoothed(about, *smoothed))

    def smoothed_as(self, sequence: int, *missing: int) -> Match:
        answering = sorted({*range(CHANNELS)} - {*missing})
        candidates = [self.candidate(channel + 100, sequence) for channel in answering]
        return fuse(candidates, self.config.matching, missing=missing)

    @property
    def published_smoothed(self) -> list[tuple[int, Match, int]]:
        return [
            (about.sequence, message.match, message.lag)
            for about, message in self.smoothed_matches.sent
            if isinstance(message, SmoothedMessage)
        ]

    def pass_time(self, seconds: float) -> None:
        self._clock.now += seconds
        self._fuser.release()

    def expected(self, sequence: int, *missing: int) -> Match:
        answering = sorted({*range(CHANNELS)} - {*missing})
        candidates = [self.candidate(channel, sequence) for channel in answering]
        return fuse(candidates, self.config.matching, missing=missing)

    @property
    def published(self) -> list[tuple[int, Match]]:
        return [
            (about.sequence, message.match)
            for about, message in self.matches.sent
            if isinstance(message, MatchMessage)
        ]
