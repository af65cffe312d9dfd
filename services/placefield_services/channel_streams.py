"""One stream in all channels of a worker: compared frames in, candidates out."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from placefield.bus.history import Outbox, Recall
from placefield.bus.messages import (
    BordersMessage,
    CandidatesMessage,
    ChannelCandidate,
    Header,
)
from placefield.config import Rule
from placefield.maps.map import MapMetric
from placefield.matching.candidate import Candidate
from placefield.matching.channel_matcher import ChannelMatcher
from placefield.matching.comparing import Comparison

Seen = Mapping[MapMetric, Comparison]
"""How a frame compares with the places under each metric; empty: it was not seen."""


@dataclass(frozen=True)
class Outlet:
    """Where a worker publishes what it makes of a run, and asks others for what it missed.

    Attributes:
        candidates: where they are published.
        recall: returns descriptors that others remember.
        borders: where its shards tell the others what they found.
        recall_borders: yields what all shards have told of frames from one up to another.
    """

    candidates: Outbox
    recall: Recall
    borders: Outbox
    recall_borders: Callable[[str, int, int], Iterable[tuple[Header, bytes]]]


@dataclass(frozen=True)
class Frame:
    """A frame to answer.

    Attributes:
        header: of it.
        see: called once, when it is its turn.
        is_awaited: whether it is to be answered; else it was long ago, and is only to be known of.
    """

    header: Header
    see: Callable[[], Seen]
    is_awaited: bool


class ChannelStream(ABC):
    """Answers frames in their order; what did not come is matched as frames that were not seen."""

    @abstractmethod
    def take(self, frame: Frame) -> None:
        """Take the next frame that came."""

    def hear(self, header: Header, told: BordersMessage) -> None:  # noqa: B027
        """Take what another worker tells of its shards."""

    def settle(self) -> None:  # noqa: B027
        """Do what is due."""


class WholeStream(ChannelStream):
    """A stream in whole channels: each frame is answered at once."""

    def __init__(
        self,
        matchers: Mapping[int, tuple[MapMetric, ChannelMatcher]],
        rule: Rule,
        first: int,
        candidates: Outbox,
    ) -> None:
        """Take each channel's metric and new matcher, and the number of the first frame."""
        self._matchers = matchers
        self._rule: Rule = rule
        self._next = dict.fromkeys(matchers, first)  # by channel: a defect may cost one a frame
        self._candidates = candidates

    def take(self, frame: Frame) -> None:
        """Publish the candidates of all channels for a frame."""
        if frame.header.end:
            self._candidates.put(frame.header)
            return
        candidates = self._push(frame.header.sequence, frame.see())
        if frame.is_awaited:
            self._candidates.put(frame.header, candidates_message(self._rule, candidates))

    def _push(self, sequence: int, seen: Seen) -> dict[int, Candidate]:
        candidates = {}
        for number, (metric, matcher) in self._matchers.items():
            for _ in range(min(sequence - self._next[number], matcher.memory)):
                matcher.push(None)
            self._next[number] = sequence
            candidates[number] = matcher.push(seen.get(metric))
            self._next[number] = sequence + 1
        return candidates


def candidates_message(
    rule: Rule, candidates: Mapping[int, Candidate], shard: int = 0, shards: int = 1
) -> CandidatesMessage:
    """Return what a worker says of a frame: the candidate of each channel, or of a shard of it."""
    written = tuple(ChannelCandidate.of(*each) for each in candidates.items())
    return CandidatesMessage(rule=rule, shard=shard, shards=shards, candidates=written)
