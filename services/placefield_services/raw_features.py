"""The raw features that a featurizer gets from the describers of a run."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from itertools import takewhile
from typing import Any, NamedTuple

from placefield.bus.credits import WINDOW
from placefield.bus.inbox import Inbox, Received
from placefield.bus.keys import service_and_identity
from placefield.bus.message import Header
from placefield.bus.messages import RawFeatureMessage
from placefield.bus.refusing import count_refused
from placefield.bus.session import Bus
from placefield.errors import MessageError, OtherMapError
from placefield.features.extract import Array
from placefield_services.background_query import NotYet
from placefield_services.live_describers import LiveDescribers, live_describers
from placefield_services.process import ServiceProcess

MOST = 4 * WINDOW
"""The most frames that are left to describers at a time, and the most raw features kept."""

_LIVE_FRAMES = 2
"""Live frames of a run that may wait for the featurizer itself; older ones are dropped."""

_LOOK_EVERY_S = 0.05  # whether an awaited describer has died

_Frame = tuple[str, int]  # stream and sequence


class RawKind(NamedTuple):
    """The raw features that a featurizer accepts.

    Attributes:
        model: fingerprint of their model.
        dimensions: their dimension; None: none are accepted.
    """

    model: str
    dimensions: int | None

    def check(self, message: RawFeatureMessage) -> None:
        """Refuse a raw feature of another kind.

        Raises:
            MessageError: it has another dimension.
            OtherMapError: it is of another model.
        """
        if message.model != self.model:
            raise OtherMapError(
                f"raw feature of model {message.model!r:.70}, not {self.model}; "
                "give all services one map"
            )
        if message.raw is not None and len(message.raw) != self.dimensions:
            raise MessageError(
                f"raw feature of dimension {len(message.raw)}, not {self.dimensions}"
            )


class RawFeatures:
    """Leaves frames to the describers of a run, and keeps the raw features that come.

    It waits for a describer that lives and has sent a raw feature, until that one has been silent
    for a while; then no longer, until its next raw feature. A describer sends in the order of the
    frames: when a frame has come, no earlier frame of the same describer is waited for.

    Counts as ``described_here`` the frames that were left to a describer and remain for the
    featurizer. A raw feature that is refused counts as ``malformed`` or ``other_map``.
    """

    def __init__(
        self,
        describers: LiveDescribers,
        kind: RawKind,
        patience_s: float,
        counts: Counter[str],
    ) -> None:
        """Begin with no frame.

        Args:
            describers: of the run.
            kind: the raw features to accept.
            patience_s: how long a describer may be silent, seconds.
            counts: of the run.
        """
        self._describers = describers
        self._kind = kind
        self._patience_s = patience_s
        self._counts = counts
        self._left_to: dict[_Frame, str] = {}  # in the order of arrival
        self._come: dict[_Frame, Array | None] = {}  # None: it will not come
        self._heard: dict[str, float] = {}  # when each describer that is waited for last sent
        self._asked: tuple[_Frame, float] | None = None
        self._lock = threading.Lock()

    def leave(self, header: Header) -> None:
        """Leave a frame that has arrived to the describer whose turn it is, if there is one."""
        describer, frame = self._describers.whose(header.sequence), _frame(header)
        if describer is None or header.end:
            return
        with self._lock:
            self._left_to.pop(frame, None)  # a frame that comes again is the newest
            if frame not in self._come:
                self._left_to[frame] = describer
                _limit(self._left_to)

    def is_awaited(self, header: Header) -> bool:
        """Return whether the raw feature of a frame has not come, and is worth waiting for."""
        with self._lock:
            return self._is_awaited(_frame(header))

    def _is_awaited(self, frame: _Frame) -> bool:
        describer = self._left_to.get(frame)
        return describer in self._heard and describer in self._describers.alive

    def receive(self, received: Received, release: Callable[[str], None]) -> None:
        """Keep a raw feature; call ``release`` with its run if an asked frame waits no longer."""
        frame, describer = _frame(received.header), service_and_identity(received.key)[1]
        try:
            raw = self._decode(received.payload)
        except MessageError as error:
            count_refused(self._counts, error)
            with self._lock:
                self._heard.pop(describer, None)
        else:
            with self._lock:
                self._keep(frame, describer, raw)
        with self._lock:
            is_over = self._asked is not None and not self._is_awaited(self._asked[0])
        if is_over:
            release(received.run)

    def _decode(self, payload: bytes) -> Array | None:
        message = RawFeatureMessage.decode(payload)
        self._kind.check(message)
        return message.raw

    def _keep(self, frame: _Frame, describer: str, raw: Array | None) -> None:
        alive = self._describers.alive
        self._heard = {one: at for one, at in self._heard.items() if one in alive}
        if describer in alive:
            self._heard[describer] = time.monotonic()
        if self._left_to.get(frame) == describer:
            for passed in takewhile(lambda other: other != frame, list(self._left_to)):
                if self._left_to[passed] == describer:
                    del self._left_to[passed]
                    self._come.setdefault(passed, None)
        self._left_to.pop(frame, None)
        if self._come.get(frame) is None:
            self._come[frame] = raw
        _limit(self._come)

    def take(self, header: Header) -> Array | None:
        """Return the raw feature of a frame, once; None: describe the frame.

        Raises:
            NotYet: the frame is awaited.
        """
        frame, now = _frame(header), time.monotonic()
        with self._lock:
            if self._is_awaited(frame):
                self._wait(frame, now)
            self._asked = None
            was_left = frame in self._left_to or frame in self._come
            self._left_to.pop(frame, None)
            raw = self._come.pop(frame, None)
        if raw is None and was_left:
            self._counts["described_here"] += 1
        return raw

    def _wait(self, frame: _Frame, now: float) -> None:
        """Wait for an awaited frame, or give up its describer, which has been silent for too long.

        Raises:
            NotYet: wait.
        """
        describer = self._left_to[frame]
        if self._asked is None or self._asked[0] != frame:
            self._asked = frame, now
        end = max(self._asked[1], self._heard[describer]) + self._patience_s
        if now < end:
            raise NotYet(min(end - now, _LOOK_EVERY_S))
        del self._heard[describer]


def receive_frames(
    bus: Bus, process: ServiceProcess, kind: RawKind, patience_s: float
) -> tuple[Inbox, Mapping[str, RawFeatures]]:
    """Receive the frames of a featurizer, and their raw features from the describers of each run.

    Returns:
        The inbox of the frames, and the raw features of each run.
    """
    raws = {
        run: RawFeatures(live_describers(bus, keys), kind, patience_s, process.counts[run])
        for run, keys in process.keys.items()
    }
    inbox = Inbox(
        process.counts,
        live_capacity=_LIVE_FRAMES,
        keeps=lambda received: raws[received.run].is_awaited(received.header),
    )

    def offer(received: Received) -> None:
        raws[received.run].leave(received.header)
        inbox.offer(received)

    for run, keys in process.keys.items():
        receive = partial(raws[run].receive, release=inbox.release)
        bus.subscribe(keys.all_raws, receive, process.counts[run])
        bus.subscribe(keys.frame, offer, process.counts[run])
    return inbox, raws


def _frame(header: Header) -> _Frame:
    return header.stream, header.sequence


def _limit(frames: dict[_Frame, Any]) -> None:
    while len(frames) > MOST:
        del frames[next(iter(frames))]
