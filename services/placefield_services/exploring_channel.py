"""The channel worker while a drive is explored: it matches each frame with the earlier ones."""

import threading
from collections import Counter
from dataclasses import dataclass

import numpy as np

from placefield.bus.candidate_messages import (
    CandidatesMessage,
    ChannelCandidate,
    FinishedMessage,
    SmoothedFrame,
    SmoothedFrames,
)
from placefield.bus.connecting import open_bus
from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import Keys, Part
from placefield.bus.message import Header
from placefield.bus.messages import FeatureMessage
from placefield.bus.refusing import count_refused
from placefield.bus.replay_cache import (
    CachedPublisher,
    Fetch,
    ReplayCache,
    replicated_cache,
)
from placefield.bus.session import Bus
from placefield.bus.streams import Turn
from placefield.config import Config, MatchingConfig
from placefield.errors import FrameError, MessageError
from placefield.features.calibration import Calibration
from placefield.features.raw_stage import raw_fingerprint
from placefield.matching.explored_candidate import to_candidate
from placefield.matching.exploring import Answer, Explorer, SmoothedAnswer
from placefield_services.background_query import BackgroundQuery
from placefield_services.channel import SERVICE
from placefield_services.channel_outputs import candidates_publisher
from placefield_services.exploring_services import check_exploring
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.whole_stream import StreamFrame, WholeStream

_CHANNEL = 0  # the only one
_FORGOTTEN_AFTER = 50  # unobserved frames; see ``FilterMatcher.horizon``
_MOST = 2**31  # frames of a stream, so that a place is an int32
_WARM_UP = 60, 64  # frames, and dimensions


def run_exploring_channel(
    config: Config, camera: Calibration | None, stop: threading.Event
) -> None:
    """Explore the drives of a run until ``stop`` is set, see ``run_exploring_featurizer``.

    Raises:
        ConfigError: a file of the network cannot be read, the rule cannot explore, or there are
            several runs.
    """
    check_exploring(config.matching)
    digest, run = raw_fingerprint(config.features.kind, camera), config.run
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, [run])
        process.maps[run] = digest
        serve_metrics(config.monitoring, process.report)
        inbox = Inbox(process.counts)  # it drops no live frame: all workers must match the same
        keys, counts = process.keys[run], process.counts[run]
        bus.subscribe(keys.feature, inbox.offer, counts)
        outputs = _outputs(bus, keys, process.identity, config.matching.lag)
        process.answers[run] = outputs.candidates.cache
        worker = ExploringWorker(digest, config.matching, outputs, counts)
        warm_up(config.matching)
        process.declare_ready(Part(_CHANNEL).identity(process.identity))
        process.serve(inbox, worker.accept, stop)


def warm_up(matching: MatchingConfig) -> None:
    """Explore a drive of noise, so that everything is loaded and compiled before serving."""
    explorer = Explorer(matching)
    for raw in np.random.default_rng(0).normal(size=_WARM_UP).astype(np.float32):
        explorer.update(raw)
    explorer.finish()


@dataclass(frozen=True)
class ExploringOutputs:
    """How a worker publishes its candidates, and keeps and fetches raw features.

    Attributes:
        candidates: publishes the candidates.
        features: raw features of the stream, for other services.
        fetch: fetches the raw features of some frames from other services, or raises ``NotYet``.
    """

    candidates: CachedPublisher
    features: ReplayCache
    fetch: Fetch


def _outputs(bus: Bus, keys: Keys, identity: str, lag: int) -> ExploringOutputs:
    candidates = candidates_publisher(bus, keys, identity, lag)
    features = replicated_cache(bus, keys.cache(keys.feature))
    return ExploringOutputs(candidates, features.cache, BackgroundQuery(features.fetch))


class ExploringWorker:
    """Explores the streams of a run, one after the other.

    An answer depends on all frames of the stream. So a worker that starts during a stream fetches
    all earlier frames, and matches them before it goes on.
    """

    def __init__(
        self,
        digest: str,
        matching: MatchingConfig,
        outputs: ExploringOutputs,
        counts: Counter[str],
    ) -> None:
        """Publish to the outputs, and count in ``counts``; ``digest`` is of the exploration."""
        self._digest = digest
        self._matching = matching
        self._outputs = outputs
        self._counts = counts
        self._stream = WholeStream(digest, outputs.fetch, self._begin, self._match, counts)
        self._explorer = Explorer(matching)
        self._smoothed: list[SmoothedAnswer] = []  # not published yet

    def accept(self, received: Received) -> None:
        """Handle a message: match its frame, missed frames first.

        Raises:
            MessageError: it is refused.
            NotYet: not all missed frames have been fetched and matched.
        """
        header = received.header
        if header.sequence >= _MOST:
            raise MessageError(f"frame {header.sequence}: a stream has {_MOST} frames at most")
        turn = self._stream.accept(header, received.payload)
        if turn is Turn.DROPPED:
            return
        self._outputs.features.store(header, received.payload)
        if turn is Turn.REPEATED:
            self._outputs.candidates.put_again(header)

    def _begin(self, header: Header) -> int:
        self._explorer = Explorer(self._matching)
        self._smoothed = []
        return 0

    def _match(self, frame: StreamFrame) -> None:
        """Match a frame, and publish the candidate if it is awaited."""
        header, feature = frame.header, frame.feature
        self._pass_to(header.sequence)
        if feature is None:
            self._finish(header)
            return
        answer = self._answer(feature)
        self._smoothed += self._explorer.smoothed()
        if not frame.is_awaited:  # it was answered, so frames older by the lag are not awaited
            oldest = header.sequence - self._matching.lag
            self._smoothed = [each for each in self._smoothed if each.frame > oldest]
            return
        message = CandidatesMessage(
            map=self._digest,
            rule=self._matching.rule,
            candidates=(ChannelCandidate.of(_CHANNEL, to_candidate(answer)),),
            smoothed=self._pop_smoothed(header.sequence),
            forgotten=self._stream.is_forgotten,
        )
        self._outputs.candidates.put(header, message)

    def _pass_to(self, sequence: int) -> None:
        """Let the frames before this one pass that did not come; none of them was observed."""
        missing = sequence - self._explorer.frames
        self._explorer.skip(max(missing - _FORGOTTEN_AFTER, 0))
        for _ in range(min(missing, _FORGOTTEN_AFTER)):
            self._explorer.update(None)

    def _answer(self, feature: FeatureMessage) -> Answer:
        try:
            return self._explorer.update(feature.descriptor)
        except FrameError as error:  # the frame must be answered nevertheless
            count_refused(self._counts, MessageError(str(error)))
            return self._explorer.update(None)

    def _finish(self, end: Header) -> None:
        """Smooth the last frames, and publish them with the end of the stream."""
        self._smoothed += self._explorer.finish()
        message = FinishedMessage(
            map=self._digest,
            rule=self._matching.rule,
            channels=(_CHANNEL,),
            smoothed=self._pop_smoothed(end.sequence),
        )
        self._outputs.candidates.put(end, message)

    def _pop_smoothed(self, sequence: int) -> SmoothedFrames | None:
        smoothed, self._smoothed = self._smoothed, []
        return SmoothedFrames.of(
            sequence,
            [
                SmoothedFrame(_CHANNEL, each.frame, each.lag, to_candidate(each.answer))
                for each in smoothed
            ],
        )
