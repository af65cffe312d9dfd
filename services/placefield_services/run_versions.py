"""The versions of a map in one run of a channel worker.

A run has one version that answers. A new version is the next one for a while: it matches the same
frames, beginning with those in the replay cache, and publishes its candidates, too. When the fuser
has gone over to it, it is the only one.
"""

import time
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Received
from placefield.bus.message import Header
from placefield.bus.messages import MatchMessage
from placefield_services.channel_streams import ChannelOutputs, ChannelStream, PendingFrame
from placefield_services.process import counting_failure
from placefield_services.served_channels import ServedChannels

_CATCH_UP_S = 0.1  # how long a new version matches frames of the past, after each batch
_AT_ONCE = 8  # frames


@dataclass(frozen=True)
class AcceptedFrame:
    """A frame to match, with the stream that was current when it came.

    A frame that is not awaited was answered before; it only updates the matchers.
    """

    served: ServedChannels
    stream: ChannelStream
    counts: Counter[str]
    header: Header
    descriptor: NDArray[np.float32] | None
    odometry_m: float | None
    is_awaited: bool = True


def match_frames(frames: Sequence[AcceptedFrame]) -> None:
    """Compare frames with the places, those of one version together, and publish candidates."""
    for served in dict.fromkeys(frame.served for frame in frames):
        own = [frame for frame in frames if frame.served is served]
        comparing = served.comparing([frame.descriptor for frame in own])
        for frame, compare in zip(own, comparing, strict=True):
            with counting_failure([frame.counts]):
                frame.stream.add(
                    PendingFrame(frame.header, compare, frame.odometry_m, frame.is_awaited)
                )


class RunVersion:
    """A version of the map in a run: what serves it, where it publishes, and its stream."""

    def __init__(self, served: ServedChannels, outputs: ChannelOutputs) -> None:
        """Serve ``served``, with outputs that no other version has."""
        self.served, self.outputs = served, outputs
        self.stream: ChannelStream | None = None
        """The stream that is on; None if none has begun under this version."""
        self._waiting: deque[AcceptedFrame] = deque()
        self._came = 0

    @property
    def digest(self) -> str:
        """Digest of the version."""
        return self.served.digest

    def begin(self, first: int) -> ChannelStream:
        """Begin a stream with the frame of this number."""
        self._waiting.clear()
        self._came = 0
        self.stream = self.served.new_stream(self.outputs, first)
        return self.stream

    def wait(self, frame: AcceptedFrame, *, is_new: bool = True) -> None:
        """Let a frame wait that the version before this one has matched.

        Args:
            frame: the frame.
            is_new: whether it has just come; if not, it is of the replay cache.
        """
        if self.stream is not None:
            self._waiting.append(replace(frame, served=self.served, stream=self.stream))
            self._came += is_new

    def catch_up(self) -> None:
        """Match some of the waiting frames: as many as have come since the last call, and more.

        To match all of the past at once would delay the answers of the version that answers.
        """
        count, self._came = self._came + _AT_ONCE, 0
        end = time.monotonic() + _CATCH_UP_S
        self._match(count)
        while self._waiting and time.monotonic() < end:
            self._match(_AT_ONCE)

    def catch_up_all(self) -> None:
        """Match all waiting frames."""
        while self._waiting:
            self._match(_AT_ONCE)

    def _match(self, count: int) -> None:
        """Match the oldest waiting frames; those that are answered by now are not published."""
        if not self._waiting:
            return
        newest = self._waiting[-1].header
        oldest = newest.sequence - WINDOW if newest.live else newest.oldest
        frames = [self._waiting.popleft() for _ in range(min(count, len(self._waiting)))]
        match_frames(
            [
                replace(frame, is_awaited=frame.is_awaited and frame.header.sequence >= oldest)
                for frame in frames
            ]
        )


class AnsweringVersion:
    """The version of the map that a run's fuser answers by, as its matches say."""

    def __init__(self) -> None:
        self.digest: str | None = None
        """Digest of the version; None before the first match."""

    def receive(self, received: Received) -> None:
        """Receive a match; a malformed one raises ``MessageError``."""
        if not received.header.end:
            self.digest = MatchMessage.decode(received.payload).map
