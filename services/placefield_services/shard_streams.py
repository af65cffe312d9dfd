"""One stream in shards of a worker's channels, which other workers have the other shards of.

Every frame takes two halves: what a shard finds of it is told to those beside it, and when all have
told, each knows its candidate. So the shards of a channel go from frame to frame together. While
one is away the others wait, and the fuser goes on without the channel. One that comes back asks
for the descriptors and for what the others told since, and all go on where they were.
"""

import time
from collections import defaultdict, deque
from collections.abc import Callable, Mapping

from placefield.bus.history import LENGTH
from placefield.bus.messages import (
    BordersMessage,
    ChannelSummary,
    Header,
)
from placefield.config import Rule
from placefield.errors import MessageError
from placefield.maps.map import MapMetric
from placefield.matching.shard_matcher import ShardMatcher, Summary
from placefield_services.channel_streams import ChannelStream, Frame, Outlet, candidates_message

_ASK_AFTER_S = 0.5  # in vain; what another told may be lost

_Key = tuple[int, int]  # channel and shard


class ShardStream(ChannelStream):
    """A stream in shards: a frame is answered when the other shards have told what they found."""

    def __init__(
        self,
        new_matchers: Callable[[], Mapping[int, tuple[MapMetric, ShardMatcher]]],
        rule: Rule,
        shard: int,
        shards: int,
        first: int,
        outlet: Outlet,
    ) -> None:
        """Begin a stream.

        Args:
            new_matchers: returns each channel's metric and a new matcher of its shard.
            rule: how candidates are made.
            shard: which, from 0.
            shards: of how many.
            first: number of the first frame.
            outlet: of its run.
        """
        self._new_matchers = new_matchers
        self._rule: Rule = rule
        self._shard, self._shards = shard, shards
        self._outlet = outlet
        self._waiting: deque[Frame] = deque()
        self._told: defaultdict[int, dict[_Key, Summary]] = defaultdict(dict)
        self._begin(first)

    def _begin(self, first: int) -> None:
        """Begin anew, with the frame of this number."""
        self._matchers = self._new_matchers()
        self._memory = max(matcher.memory for _, matcher in self._matchers.values())
        self._next = first
        self._pushed: dict[int, Summary] | None = None
        self._ask_at = time.monotonic() + _ASK_AFTER_S

    def take(self, frame: Frame) -> None:
        """Take the next frame that came; it is answered in its turn."""
        self._waiting.append(frame)
        if len(self._waiting) > 2 * LENGTH:  # none of the others will remember so many
            self._waiting.popleft()
            self._begin(self._waiting[0].header.sequence)
        self._go_on()

    def hear(self, header: Header, told: BordersMessage) -> None:
        """Take what another worker tells of its shards."""
        self._note(header.sequence, told)
        self._go_on()

    def _note(self, sequence: int, told: BordersMessage) -> None:
        if told.shards == self._shards and self._next <= sequence < self._next + 2 * LENGTH:
            for each in told.summaries:
                if each.channel in self._matchers:
                    self._told[sequence].setdefault((each.channel, told.shard), each.summary)

    def settle(self) -> None:
        """Ask again for what the next frame waits for, once in a while."""
        if self._waiting and time.monotonic() >= self._ask_at:
            self._ask()
            self._ask_at = time.monotonic() + _ASK_AFTER_S
            self._go_on()

    def _ask(self) -> None:
        first_told: dict[int, int] = {}
        stream = self._waiting[0].header.stream
        end = self._next + LENGTH
        for header, payload in self._outlet.recall_borders(stream, self._next, end):
            try:
                told = BordersMessage.decode(payload)
            except MessageError:
                continue
            self._note(header.sequence, told)
            first = min(first_told.get(told.shard, header.sequence), header.sequence)
            first_told[told.shard] = first
        began = max(first_told.values(), default=self._next)
        if began > self._next:  # another has begun anew, too late for the frame that is next
            while self._waiting and self._waiting[0].header.sequence < began:
                self._waiting.popleft()
            self._begin(began)

    def _go_on(self) -> None:
        """Answer the frames of which all shards have told."""
        while self._waiting:
            frame = self._waiting[0]
            if frame.header.end:
                self._outlet.candidates.put(frame.header)
                self._waiting.popleft()
                continue
            if self._pushed is None:
                self._push(frame)
            if not self._all_told():
                return
            self._finish(frame)

    def _push(self, frame: Frame) -> None:
        """Push the frame, or one before it that was not seen, and tell the others."""
        self._next = max(self._next, frame.header.sequence - self._memory)
        for old in [old for old in self._told if old < self._next]:
            del self._told[old]
        seen = frame.see() if self._next == frame.header.sequence else {}
        self._pushed = {
            channel: matcher.push(seen.get(metric))
            for channel, (metric, matcher) in self._matchers.items()
        }
        message = BordersMessage(
            shard=self._shard,
            shards=self._shards,
            summaries=tuple(
                ChannelSummary(channel=channel, summary=summary)
                for channel, summary in self._pushed.items()
            ),
        )
        self._outlet.borders.put(frame.header.model_copy(update={"sequence": self._next}), message)
        self._note(self._next, message)

    def _all_told(self) -> bool:
        """Whether all shards have told of the frame that was pushed."""
        assert self._pushed is not None
        told = self._told[self._next]
        for key in [key for key in told if key[0] in self._pushed]:
            if len(told[key]) != len(self._pushed[key[0]]):
                del told[key]  # it is of another map, or rule
        return all((c, shard) in told for c in self._pushed for shard in range(self._shards))

    def _finish(self, frame: Frame) -> None:
        told = self._told.pop(self._next)
        candidates = {
            channel: matcher.finish([told[channel, shard] for shard in range(self._shards)])
            for channel, (_, matcher) in self._matchers.items()
        }
        self._next += 1
        self._pushed = None
        self._ask_at = time.monotonic() + _ASK_AFTER_S
        if self._next <= frame.header.sequence:
            return  # this was one that did not come
        self._waiting.popleft()
        if frame.is_awaited:
            message = candidates_message(self._rule, candidates, self._shard, self._shards)
            self._outlet.candidates.put(frame.header, message)
