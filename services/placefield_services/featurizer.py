"""The featurizer: it receives frames and publishes their descriptors."""

import logging
import threading
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

from placefield.bus.connecting import open_bus
from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Received
from placefield.bus.message import Header
from placefield.bus.messages import (
    FeatureMessage,
    FrameMessage,
    MissingObservationMessage,
    MomentsMessage,
)
from placefield.bus.replay_cache import LENGTH, MOMENTS, CachedPublisher, replicated_cache
from placefield.bus.streams import StreamFollower, Turn
from placefield.config import Config
from placefield.errors import FrameError, MessageError
from placefield.features.descriptor_stage import (
    Array,
    DescriptorStage,
    FrameStage,
    FrameStream,
    warm_up,
)
from placefield.features.descriptors import Moments
from placefield.maps.map import Map, fingerprint
from placefield_services.background_query import BackgroundQuery, NotYet
from placefield_services.featurizer_outputs import FeaturizerOutputs
from placefield_services.frame_of_message import frame_of
from placefield_services.frames_under_way import follow_answers
from placefield_services.process import ServiceProcess
from placefield_services.prometheus import serve_metrics
from placefield_services.raw_features import RawKind, receive_frames
from placefield_services.served import Served

log = logging.getLogger(__name__)

SERVICE = "featurizer"

_ASK_FOR_S, _ASK_EVERY_S = 1.2, 0.3
_IMPATIENT_S = 10.0  # after a failed fetch: untrusted clients may begin streams by the thousand


def run_featurizer(placemap: Map, config: Config, stop: threading.Event) -> None:
    """Serve until ``stop`` is set."""
    stage = DescriptorStage(placemap.model, config.inference)
    serve_featurizer(stage, fingerprint(placemap.model), placemap, config, stop)


def serve_featurizer(
    stage: FrameStage, model: str, served: Served, config: Config, stop: threading.Event
) -> None:
    """Serve with a stage, whose fingerprint is ``model``, until ``stop`` is set."""
    with open_bus(config.bus, stop) as bus:
        process = ServiceProcess(SERVICE, bus, config.runs)
        serve_metrics(config.monitoring, process.report)
        kind = RawKind(model, stage.raw_dimensions)
        inbox, raws = receive_frames(bus, process, kind, config.fusion.deadline_s / 4)
        outputs = {}
        for run, keys in process.keys.items():
            features = replicated_cache(bus, keys.cache(keys.feature))
            moments = replicated_cache(bus, keys.cache(keys.moments), MOMENTS)
            process.answers[run] = features.cache
            outputs[run] = FeaturizerOutputs(
                CachedPublisher(bus.gathering_publisher(keys.feature), features.cache),
                CachedPublisher(bus.newest_publisher(keys.moments), moments.cache),
                bus.publisher(keys.unobserved),
                features.fetch,
                moments.fetch,
                raws[run],
            )
        under_way = follow_answers(bus, process, inbox, 2 * config.fusion.deadline_s)
        featurizer = Featurizer(stage, model, outputs, process.counts)
        warm_up(stage)

        def handle(received: Received) -> None:
            served.check_unchanged()  # the descriptor model is memory-mapped from its files
            run, header = received.run, received.header
            if not raws[run].is_awaited(header):  # else a describer has done the work already
                under_way[run].check(header)
            under_way[run].add(header)
            described = False
            try:
                described = featurizer.handle(received)
            finally:
                if not described:  # perhaps not yet: newer frames may displace it
                    under_way[run].discard(header)

        with process.sole():
            # A batch of frames saves no work, not even a network's on the CPU, and a waiting frame
            # can still be displaced.
            process.serve(inbox, handle, stop, at_once=1)


@dataclass
class _FeaturizerRun:
    outputs: FeaturizerOutputs
    counts: Counter[str]
    follower: StreamFollower
    images: FrameStream
    complained_of: str = ""
    """The last stream for which an unreadable frame was logged."""
    patient_from: float = 0.0
    background_query: BackgroundQuery[[Header], "_KnownStream"] = field(init=False)
    asked_of: str = ""
    """The last stream that was fetched from other replay caches."""
    ask_until: float = 0.0
    forgets: bool = False
    """Whether too little was cached of the current stream to resume it."""
    known: "_KnownStream" = field(default_factory=lambda: _KnownStream(-1, None))
    """The cached part of the current stream."""


@dataclass(frozen=True)
class _KnownStream:
    """The part of a stream that other replay caches have.

    Attributes:
        made: the last frame that was described; -1: none.
        moments: of the stream after that frame.
    """

    made: int
    moments: Moments | None


class Featurizer:
    """Makes each frame of a stream into its descriptor, in one stream per run at a time.

    Counts ``unreadable`` frames; they are published as missing observations, so that each frame is
    answered. A lossless stream is described in order: a frame that comes ``out_of_order`` is
    dropped, as the source sends it again.
    """

    def __init__(
        self,
        stage: FrameStage,
        model: str,
        outputs: Mapping[str, FeaturizerOutputs],
        counts: Mapping[str, Counter[str]],
    ) -> None:
        """Describe with a stage, whose fingerprint is ``model``.

        Publish to the outputs of each run, and count in the counts of each run.
        """
        self._stage = stage
        self._fingerprint = model
        self._runs = {
            run: _FeaturizerRun(
                outputs,
                counts[run],
                StreamFollower(counts[run], partial(self._join, run)),
                self._stage.new_stream(),
            )
            for run, outputs in outputs.items()
        }
        for each in self._runs.values():
            each.background_query = BackgroundQuery(partial(self._fetch, each))

    def handle(self, received: Received) -> bool:
        """Handle a frame: publish its descriptor; return whether it was its turn.

        Raises:
            NotYet: the stream began earlier, and its cached part has not been fetched yet; or a
                describer has not described the frame yet.
        """
        header, run = received.header, self._runs[received.run]
        frame = None if header.end else FrameMessage.decode(received.payload)
        if run.follower.begins(header):
            run.forgets = header.sequence > 0 and not self._ask(run, header)
        described: Mapping[int, Array] = {}
        if frame is not None and frame.image is not None and run.follower.awaits(header):
            describe = partial(self._stage.feature.parts_of_frame, frame_of(header, frame))
            described = run.outputs.raws.take(header, describe)
        turn = run.follower.follow(header)
        if turn is Turn.AFTER_GAP and header.live:
            run.follower.skip_to(header.sequence)
            turn = Turn.NEXT
        if turn is Turn.AFTER_GAP:
            run.counts["out_of_order"] += 1
        if turn is Turn.NEXT:
            self._publish(run, header, frame, described)
        if turn is Turn.REPEATED and (header.end or not header.live):
            run.outputs.features.put_again(header)
        return turn is Turn.NEXT

    def _join(self, name: str, header: Header) -> int:
        """Begin a stream, or resume it where the previous featurizer ended; return its frame."""
        run = self._runs[name]
        run.images = self._stage.new_stream()
        if header.sequence == 0:
            return 0
        made, moments = run.known.made, run.known.moments
        run.images = self._stage.new_stream(moments)
        return header.sequence if header.live else max(made + 1, header.oldest)

    def _ask(self, run: _FeaturizerRun, header: Header) -> bool:
        """Fetch the cached part of a stream; return whether it is enough to resume the stream.

        Raises:
            NotYet: the answer has not come.
        """
        now = time.monotonic()
        if run.asked_of != header.stream:
            run.asked_of = header.stream
            run.ask_until = now + (_ASK_FOR_S if now >= run.patient_from else 0)
        run.known = run.background_query(header.stream, header)
        if self._goes_on(header, run.known):
            return True
        if time.monotonic() < run.ask_until:  # a cache may not be reachable at once
            raise NotYet(_ASK_EVERY_S)
        run.counts["forgotten"] += 1
        run.patient_from = time.monotonic() + _IMPATIENT_S
        return False

    def _goes_on(self, header: Header, known: _KnownStream) -> bool:
        """Return whether enough is known to resume a stream as its featurizer would have done."""
        has_moments = known.moments is not None or not self._stage.standardises
        needed = 0 if header.live else header.oldest - 1
        return known.made >= needed and has_moments

    def _fetch(self, run: _FeaturizerRun, stream: str, header: Header) -> _KnownStream:
        """Fetch the cached part of a stream; this runs in its own thread."""
        first, end = max(0, header.sequence - LENGTH), header.sequence + 2 * WINDOW
        features = run.outputs.fetch_features(stream, first, end)
        for feature in features.values():
            run.outputs.features.cache.store(*feature)
        described = [sequence for sequence, (about, _) in features.items() if not about.end]
        last = max(described, default=-1)
        fetched = run.outputs.fetch_moments(stream, last, last + 1) if described else {}
        made = max(features, default=-1)
        own = run.images.moments
        if own is None or last not in fetched:
            return _KnownStream(made, None)
        try:
            moments = MomentsMessage.decode(fetched[last][1])
        except MessageError:
            return _KnownStream(made, None)
        fits = moments.sums.shape == own.sums.shape
        return _KnownStream(made, Moments(moments.frames, moments.sums) if fits else None)

    def _publish(
        self,
        run: _FeaturizerRun,
        header: Header,
        frame: FrameMessage | None,
        described: Mapping[int, Array],
    ) -> None:
        feature = None if frame is None else self._describe(run, header, frame, described)
        moments = run.images.moments if self._stage.standardises else None
        if moments is not None and feature is not None:  # before the descriptor made with them
            message = MomentsMessage(frames=moments.frames, sums=moments.sums)
            run.outputs.moments.put(header, message)
        run.outputs.features.put(header, feature)

    def _describe(
        self,
        run: _FeaturizerRun,
        header: Header,
        message: FrameMessage,
        described: Mapping[int, Array],
    ) -> FeatureMessage:
        """Return the descriptor of a frame, of which some parts may be described already."""
        descriptor = None
        try:
            raw = self._stage.feature.of_frame(frame_of(header, message), described)
            descriptor = run.images.update_raw(raw)
            if descriptor is None:
                run.counts["blank"] += 1
                run.outputs.unobserved.put(header, MissingObservationMessage(reason="blank"))
        except FrameError as error:
            run.counts["unreadable"] += 1
            run.outputs.unobserved.put(header, MissingObservationMessage(reason="unreadable"))
            if run.complained_of != header.stream:
                run.complained_of = header.stream
                log.warning(
                    "frame %d is a missing observation: %s; further ones of its stream are only "
                    "counted",
                    header.sequence,
                    error,
                )
        except Exception:  # a defect loses the observation, but the frame is answered
            run.counts["failed"] += 1
            log.exception("a defect; the frame is a missing observation")
        return FeatureMessage(
            model=self._fingerprint,
            descriptor=descriptor,
            odometry_m=message.odometry_m,
            forgotten=run.forgets,
        )
