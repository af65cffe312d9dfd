"""Publishing of the fuser: matches, smoothed matches, and credits for the source."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage, SmoothedMessage
from placefield.bus.publishing import Publisher
from placefield.bus.replay_cache import CachedPublisher
from placefield.fusion.fusion_stage import AnyFusionStage
from placefield.fusion.joiner import Joined
from placefield.fusion.match import Match
from placefield.fusion.smoothed_joiner import JoinedSmoothed
from placefield.matching.candidate import UNANSWERED, Candidate
from placefield_services.process import counting_failure
from placefield_services.served import Served


@dataclass(frozen=True)
class FuserOutputs:
    """Where a fuser publishes matches, smoothed matches, and the headers of answered frames."""

    matches: CachedPublisher
    smoothed: CachedPublisher
    acks: Publisher


class MatchPublisher:
    """Makes one match of the joined candidates of a frame, and publishes it."""

    def __init__(
        self, served: Served, stage: AnyFusionStage, outputs: FuserOutputs, counts: Counter[str]
    ) -> None:
        self._map = served
        self._stage = stage
        self._outputs = outputs
        self._counts = counts

    def publish(self, header: Header, joined: Joined, *, forgotten: bool) -> None:
        """Publish the match of a frame; ``forgotten``: see ``Match``."""
        match = replace(self._fuse(joined.candidates, joined.missing), forgotten=forgotten)
        message = MatchMessage.of(match, map=self._map.digest)
        self._outputs.matches.put(header, message)
        self._counts["matches"] += 1
        if message.too_fast:
            self._counts["too_fast"] += 1

    def publish_smoothed(self, header: Header, joined: JoinedSmoothed, *, forgotten: bool) -> None:
        """Publish the smoothed match of a frame; ``forgotten``: see ``Match``."""
        match = replace(self._fuse(joined.candidates, joined.missing), forgotten=forgotten)
        message = SmoothedMessage.of(match, map=self._map.digest, lag=joined.lag)
        self._outputs.smoothed.put(header, message)
        self._counts["smoothed"] += 1

    def end_matches(self, end: Header) -> None:
        """Say that the matches of a stream are over."""
        self._outputs.matches.put(end)

    def end_smoothed(self, end: Header) -> None:
        """Say that the smoothed matches of a stream are over."""
        self._outputs.smoothed.put(end)

    def acknowledge(self, header: Header) -> None:
        """Send the source the credit of this frame and of all before it."""
        self._outputs.acks.put(header)

    def answer_again(self, header: Header) -> None:
        """Publish again what was answered to a frame, for its source has not received it."""
        if self._outputs.matches.put_again(header):
            self.acknowledge(header)

    def _fuse(self, candidates: Mapping[int, Candidate], missing: Collection[int]) -> Match:
        """Fuse the candidates of a frame; a defect costs its answer, and no other's."""
        with counting_failure([self._counts]):
            return self._stage.fuse(list(candidates.values()), sorted(missing))
        return Match(UNANSWERED, 0.0, tuple(range(len(self._map.channels))))
