"""Matches the streams of a channel worker's runs, each under one version of the map or two."""

import time
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from placefield.bus.candidate_messages import HaloMessage
from placefield.bus.inbox import Received
from placefield.bus.keys import Keys
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.bus.refusing import counting_refused
from placefield.bus.replay_cache import LENGTH, ReplayCache, fetched_frame
from placefield.bus.streams import StreamFollower, Turn
from placefield.errors import FrameError, MessageError, OtherMapError
from placefield.maps.map import fingerprint
from placefield_services.channel_outputs import ChannelOutputs
from placefield_services.channel_streams import ChannelStream
from placefield_services.run_versions import (
    AcceptedFrame,
    AnsweringVersion,
    RunVersion,
    match_frames,
)
from placefield_services.served_channels import ServedChannels

_MOST_PENDING = 256  # messages
_ASK_FOR_S = 3.0

_Observed = tuple[NDArray[np.float32] | None, float | None]
"""The descriptor of a frame (None: a missing observation), and its odometry, metres."""


@dataclass
class _ChannelRun:
    counts: Counter[str]
    follower: StreamFollower
    current: RunVersion
    next: RunVersion | None = None
    """A new version of the map, until the fuser has gone over to it."""
    left: str = ""
    """Digest of the version before the current one; other shards may still match by it."""
    newest: Header | None = None
    """The header of the newest accepted frame, or of the stream's end."""
    is_joining: bool = False
    """Whether the stream began earlier, and its frames have not been fetched yet."""
    ask_until: float = 0.0
    """Until then missing frames may still be fetched, monotonic seconds."""
    pending: deque[tuple[Header, HaloMessage]] = field(
        default_factory=lambda: deque(maxlen=_MOST_PENDING)
    )
    """Partial results of a stream that has not begun here yet."""

    @property
    def versions(self) -> list[RunVersion]:
        """The version that answers, and the next one, if there is one."""
        return [self.current] if self.next is None else [self.current, self.next]

    @property
    def outputs(self) -> ChannelOutputs:
        """Those of the version that answers."""
        return self.current.outputs

    @property
    def streams(self) -> list[ChannelStream]:
        """The stream that is on, under each version."""
        return [each.stream for each in self.versions if each.stream is not None]


class ChannelWorker:
    """Matches streams of descriptors in one or more channels, one stream per run at a time.

    The frames of all runs are compared with the places together.
    """

    def __init__(
        self,
        channels: ServedChannels,
        outputs: Mapping[str, ChannelOutputs],
        counts: Mapping[str, Counter[str]],
    ) -> None:
        """Publish to the outputs of each run, and count in the counts of each run."""
        self._descriptors = channels.model
        self._model = fingerprint(channels.model)
        self.answering = {run: AnsweringVersion() for run in outputs}
        """By run, the version that its fuser answers by."""
        self._runs = {
            run: _ChannelRun(
                counts[run],
                StreamFollower(counts[run], partial(self._join, run)),
                RunVersion(channels, outputs),
            )
            for run, outputs in outputs.items()
        }

    def offer(self, served: ServedChannels) -> None:
        """Make a version of the map the next one of each run; it displaces one that still is."""
        for run in self._runs.values():
            if run.next is not None:
                run.next.outputs.retire()
                run.next = None
            if served.digest != run.current.digest:
                run.next = RunVersion(served, run.outputs.another())
                self._join_next(run, run.next)

    def _join_next(self, run: _ChannelRun, version: RunVersion) -> None:
        """Let a new version match the cached frames of the stream, and all later ones."""
        if run.current.stream is None or run.newest is None:
            return
        if run.newest.end:
            version.begin(run.follower.next)
            return
        stream = version.begin(max(0, run.follower.next - LENGTH))
        stream.is_forgotten = run.current.stream.is_forgotten
        cached = run.outputs.features.messages(run.newest.stream, run.follower.next)
        for header, payload in cached:
            with suppress(MessageError):  # it was counted when it came
                version.wait(self._accepted(run, header, self._decode(payload)), is_new=False)

    def newest_answers(self, run: str) -> tuple[ReplayCache, str]:
        """Return the answers of the version that answers a run, and the version's digest."""
        current = self._runs[run].current
        return current.outputs.candidates.cache, current.digest

    def accept(self, received: Received) -> list[AcceptedFrame]:
        """Handle a message; return the frames to match, missed frames first.

        Raises:
            NotYet: missed frames have been queried, and the answer has not come.
        """
        header, run = received.header, self._runs[received.run]
        if received.key != Keys(received.run).feature:
            self._receive(run, header, HaloMessage.decode(received.payload))
            return []
        observed = (None, None) if header.end else self._decode(received.payload)
        turn = run.follower.follow(header)
        if turn is Turn.DROPPED:
            return []
        run.outputs.features.store(header, received.payload)
        if turn is Turn.REPEATED:
            for version in run.versions:
                version.outputs.candidates.put_again(header)
            return []
        missed = self._missed(run, header) if turn is Turn.AFTER_GAP else []
        if missed is None:
            run.counts["out_of_order"] += 1
            return []
        run.newest = header
        return [*missed, self._accepted(run, header, observed)]

    def _accepted(
        self, run: _ChannelRun, header: Header, observed: _Observed, *, is_awaited: bool = True
    ) -> AcceptedFrame:
        served, stream = run.current.served, run.current.stream
        assert stream is not None
        return AcceptedFrame(served, stream, run.counts, header, *observed, is_awaited)

    def _missed(self, run: _ChannelRun, header: Header) -> list[AcceptedFrame] | None:
        """Fetch the frames of the gap before this one, and skip to the frame after it.

        None: not all frames could be fetched yet; the source will send this frame again.
        """
        first = max(run.follower.next, header.sequence - LENGTH)
        is_asked = run.is_joining or run.current.served.needs_all or not header.live
        frames = self._fetch(run, header, first) if is_asked else []
        is_complete = len(frames) == header.sequence - first
        if not is_complete and not header.live and time.monotonic() < run.ask_until:
            return None
        # A live stream drops frames on purpose, so missing frames alone do not mean a loss.
        is_forgotten = not is_complete and (not header.live or (run.is_joining and not frames))
        for stream in run.streams if is_forgotten else ():
            stream.is_forgotten = True
        unknown = 0 if run.is_joining else header.sequence - run.follower.next - len(frames)
        run.follower.skip_to(header.sequence, gaps=max(unknown, 0))
        run.is_joining, run.ask_until = False, time.monotonic() + _ASK_FOR_S
        return frames

    def _receive(self, run: _ChannelRun, header: Header, partials: HaloMessage) -> None:
        """Pass on the partial results of another shard, or keep them for a later stream.

        Raises:
            OtherMapError: they are of no version that is or was served.
        """
        if partials.map == run.left:
            run.counts["stale"] += 1
            return
        version = next((one for one in run.versions if one.digest == partials.map), run.current)
        partials.check_map(version.digest)
        if run.current.stream is None or header.stream != run.follower.stream:
            run.pending.append((header, partials))
        elif version.stream is not None:
            version.stream.receive(header, partials)

    def _join(self, name: str, header: Header) -> int:
        """Begin a stream; return its first frame, which is earlier if the stream began before."""
        run = self._runs[name]
        first = max(0, header.sequence - LENGTH)
        for version in run.versions:
            version.begin(first)
        run.is_joining, run.ask_until = header.sequence > 0, time.monotonic() + _ASK_FOR_S
        pending = list(run.pending)
        run.pending.clear()
        for about, partials in pending:
            with suppress(MessageError):  # its version was served when it came
                self._receive(run, about, partials)
        return first

    def _fetch(self, run: _ChannelRun, header: Header, first: int) -> list[AcceptedFrame]:
        """Fetch the frames before this one from other replay caches."""
        frames = []
        for old, payload in run.outputs.fetch(header.stream, first, header.sequence).values():
            with counting_refused(run.counts):
                observed = self._decode(payload)
                run.outputs.features.store(old, payload)
                old, is_awaited = fetched_frame(old, header)
                frames.append(self._accepted(run, old, observed, is_awaited=is_awaited))
        run.counts["fetched"] += len(frames)
        return frames

    def _decode(self, payload: bytes) -> _Observed:
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

    def match(self, accepted: Sequence[Sequence[AcceptedFrame]]) -> None:
        """Compare the frames with the places, and publish the candidates of all channels.

        The next version matches its frames in ``after_batch``.
        """
        frames = list(chain.from_iterable(accepted))
        match_frames(frames)
        for run in self._runs.values():
            if run.next is not None:
                for frame in frames:
                    if frame.stream is run.current.stream:
                        run.next.wait(frame)

    def after_batch(self, run: str) -> None:
        """Continue a run's stream after each batch of messages."""
        of_run = self._runs[run]
        if of_run.next is not None:
            if self.answering[run].digest == of_run.next.digest:
                self._go_over(of_run, of_run.next)
            else:
                of_run.next.catch_up()
        for stream in of_run.streams:
            stream.after_batch()

    def _go_over(self, run: _ChannelRun, version: RunVersion) -> None:
        """Answer by the next version alone, as the fuser does; the other one is freed."""
        version.catch_up_all()
        run.outputs.retire()
        run.left = run.current.digest
        run.current, run.next = version, None
